// SPDX-License-Identifier: Apache-2.0
//
// The configs that come with the workload program say what it does.
#include <fnmatch.h>
#include <yaml-cpp/yaml.h>

#include <string>

#include "tests/support/catch.h"
#include "tools/chains/scenario.h"
#include "tools/chains/spec.h"

using namespace urgengo::chains;

namespace {

const Scenario kAsRun{1, 1, tight_chains(0.4)};  // the defaults of `run`

YAML::Node load(const char* file) {
    return YAML::LoadFile(std::string(URGENGO_CHAINS_FOLDER "/") + file);
}

/// The chain as a calibrated workload has it, without kernels.
Chain chain_of(const ChainSpec& spec) {
    Chain chain{spec.name, spec.period_ms, spec.deadline_ms, {}};
    for (const TaskSpec& task : spec.tasks) {
        chain.tasks.emplace_back();
        chain.tasks.back().name = task.name;
    }
    return chain;
}

void check_chain(const YAML::Node& yaml, const Chain& chain) {
    CHECK(yaml["name"].as<std::string>() == chain.name);
    CHECK(yaml["period_ms"].as<double>() == kAsRun.period_ms(chain));
    CHECK(yaml["deadline_ms"].as<double>() == kAsRun.deadline_ms(chain));
}

bool matches(const YAML::Node& task, const std::string& thread) {
    return fnmatch(task["thread"].as<std::string>().c_str(), thread.c_str(), 0) == 0;
}

}  // namespace

TEST_CASE("chains.yaml describes the workload with hints", "[unit][chains]") {
    const YAML::Node yaml = load("chains.yaml")["chains"];
    REQUIRE(yaml.size() == paper_chains().size());
    for (std::size_t i = 0; i < yaml.size(); i++) {
        const Chain chain = chain_of(paper_chains()[i]);
        CAPTURE(chain.name);
        check_chain(yaml[i], chain);
        CHECK(yaml[i]["arrival"]["from"].as<std::string>() == "hint");
        CHECK(yaml[i]["on_late"].as<std::string>() == "exit");
        REQUIRE(yaml[i]["tasks"].size() == chain.tasks.size());
        for (std::size_t j = 0; j < chain.tasks.size(); j++) {
            const YAML::Node task = yaml[i]["tasks"][j];
            CHECK(task["name"].as<std::string>() == chain.tasks[j].name);
            for (const Threads threads : {Threads::kPerChain, Threads::kPerTask}) {
                CHECK(matches(task, thread_name(threads, chain, chain.tasks[j])));
            }
        }
    }
}

TEST_CASE("chains_nohints.yaml describes the workload without hints", "[unit][chains]") {
    const YAML::Node yaml = load("chains_nohints.yaml")["chains"];
    REQUIRE(yaml.size() == paper_chains().size());
    for (std::size_t i = 0; i < yaml.size(); i++) {
        const Chain chain = chain_of(paper_chains()[i]);
        CAPTURE(chain.name);
        check_chain(yaml[i], chain);
        CHECK(yaml[i]["arrival"]["from"].as<std::string>() == "first_call");
        CHECK(yaml[i]["on_late"].as<std::string>() == "continue");
        REQUIRE(yaml[i]["tasks"].size() == 1);
        CHECK(matches(yaml[i]["tasks"][0], chain.name));
        CHECK_FALSE(matches(yaml[i]["tasks"][0], "urgengo-chains"));
    }
}
