// SPDX-License-Identifier: Apache-2.0
#include "tools/bench/thread_mix_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace urgengo::bench {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMostNameBytes = 15;  // of a thread's name
constexpr int kMostStreams = 16;
constexpr int kMostKernels = 100'000;
constexpr double kMostKernel_us = 1e6;

double number(const Json& json, const char* key, double least, double most) {
    const double value = json.at(key).get<double>();
    if (!(value >= least && value <= most)) {
        throw std::runtime_error(
            fmt::format("{}: found {}, accepted: {} to {}", key, value, least, most));
    }
    return value;
}

MixLock lock_from_json(const Json& json) {
    if (json == false) return MixLock::kNever;
    if (json == true) return MixLock::kLaunching;
    if (json == "wait") return MixLock::kFrame;
    throw std::runtime_error(
        fmt::format("locks: found {}, accepted: false, true (while it launches), \"wait\" (until "
                    "its frame is done as well)",
                    json.dump()));
}

MixChain chain_from_json(const Json& json) {
    MixChain chain;
    chain.name = json.at("name").get<std::string>();
    if (chain.name.empty() || chain.name.size() > kMostNameBytes) {
        throw std::runtime_error(
            fmt::format("name: found \"{}\", accepted: 1 to {} bytes", chain.name, kMostNameBytes));
    }
    chain.period_ms = number(json, "period_ms", 0.1, 1e6);
    chain.deadline_ms = number(json, "deadline_ms", 0.1, 1e6);
    chain.offset_ms = json.value("offset_ms", 0.0);
    chain.kernels = static_cast<int>(number(json, "kernels", 1, kMostKernels));
    chain.kernel_us = static_cast<unsigned>(number(json, "kernel_us", 1, kMostKernel_us));
    if (json.contains("streams")) {
        chain.streams = static_cast<int>(number(json, "streams", 1, kMostStreams));
    }
    if (json.contains("locks")) chain.locks = lock_from_json(json["locks"]);
    chain.waits_for = json.value("waits_for", "");
    return chain;
}

MixSpec spec_from_json(const Json& json) {
    MixSpec spec;
    for (const Json& chain : json.at("chains")) spec.chains.push_back(chain_from_json(chain));
    for (const MixChain& chain : spec.chains) {
        const auto is_waited_for = [&](const MixChain& other) {
            return other.name == chain.waits_for && &other != &chain;
        };
        if (!chain.waits_for.empty() &&
            std::none_of(spec.chains.begin(), spec.chains.end(), is_waited_for)) {
            throw std::runtime_error(
                fmt::format("waits_for: found {}, accepted: another chain", chain.waits_for));
        }
    }
    if (json.contains("bystander") && !json["bystander"].is_null()) {
        const Json& its = json["bystander"];
        spec.bystander =
            MixBystander{static_cast<int>(number(its, "kernels", 1, kMostKernels)),
                         static_cast<unsigned>(number(its, "kernel_us", 1, kMostKernel_us))};
    }
    return spec;
}

}  // namespace

MixSpec read_mix_spec(const std::string& path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error(path + ": cannot be read");
    try {
        return spec_from_json(Json::parse(file));
    } catch (const std::exception& error) {
        throw std::runtime_error(path + ": " + error.what());
    }
}

}  // namespace urgengo::bench
