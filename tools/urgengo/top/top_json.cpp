// SPDX-License-Identifier: Apache-2.0
//
// `urgengo top --once --json`. Its fields: docs/configuration.md.
#include "host/observe/miss_cause.h"
#include "tools/trace/run_json.h"
#include "tools/urgengo/top/page_words.h"
#include "tools/urgengo/top/top_view.h"

namespace urgengo::cli {
namespace {

nlohmann::ordered_json causes_json(const ChainReading& chain) {
    auto causes = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < observe::kNumCauses; ++i)
        if (chain.causes[i] > 0)
            causes.push_back({{"cause", observe::to_word(static_cast<abi::MissCause>(i))},
                              {"frames", chain.causes[i]}});
    return causes;
}

nlohmann::ordered_json last_miss_json(const PageReading& page, const ChainReading& chain) {
    const ChainReading::Miss& miss = chain.last_miss;
    if (miss.number == 0) return nullptr;
    const std::string behind = name_of_chain(page, miss.behind);
    nlohmann::ordered_json json = {{"frame", miss.number},
                                   {"cause", observe::to_word(miss.cause)},
                                   {"behind", behind},
                                   {"in_words", observe::in_words(miss.cause, behind, miss.detail)},
                                   {"late_ms", in_ms(miss.late)},
                                   {"by_cause_ms", in_ms(miss.amount)}};
    trace::add_detail(json, miss.cause, miss.detail);
    return json;
}

nlohmann::ordered_json task_json(const PageReading& page, const TaskReading& task) {
    nlohmann::ordered_json json = {{"name", task.name},
                                   {"state", to_word(task.state)},
                                   {"waits_for_gpu", task.waits_for_gpu},
                                   {"planned_gpu_ms", in_ms(task.planned_gpu)}};
    if (task.priority) json["priority"] = *task.priority;
    json["estimate_factor"] = task.factor;
    if (task.num_kernels > 0) json["kernels"] = task.num_kernels;
    if (task.kernel > 0) {
        json["kernel"] = task.kernel;
        json["kernel_name"] = task.kernel_name;
    }
    if (task.state != abi::TaskState::kIdle) {
        json["laxity_ms"] = in_ms(task.laxity);
        if (task.rank > 0) json["rank"] = task.rank;
        json["remaining_gpu_ms"] = in_ms(task.remaining_gpu);
        json["launched_ms"] = in_ms(task.launched);
    }
    if (task.why != abi::Why::kNone)
        json["waits"] = {{"why", to_word(task.why)},
                         {"behind", chain_of_task(page, task.behind)},
                         {"ms", in_ms(task.held)}};
    return json;
}

nlohmann::ordered_json dispatcher_json(const PageReading::Dispatcher& dispatcher) {
    return {{"gates", dispatcher.gates},
            {"closed", dispatcher.closed},
            {"opened_by_gpu", dispatcher.opened_by_gpu},
            {"gpu_rounds", dispatcher.gpu_rounds},
            {"gpu_round_us", 1e3 * in_ms(dispatcher.gpu_round)},
            {"urgent_laxity_ms", in_ms(dispatcher.urgent_laxity)}};
}

nlohmann::ordered_json chain_json(const PageReading& page, const ChainReading& chain) {
    nlohmann::ordered_json json = {
        {"name", chain.name},
        {"period_ms", in_ms(chain.period)},
        {"deadline_ms", in_ms(chain.deadline)},
        {"mode", to_word(mode_of(page, chain))},
        {"guard", guard_word(chain.guard)},
        {"frames", chain.instances},
        {"finished", chain.finished},
        {"missed", chain.missed},
        {"exited", chain.exited},
        {"misses_in_a_row", chain.misses_in_a_row},
        {"most_misses_in_a_row", chain.most_misses_in_a_row},
        {"late_starts", chain.late_starts},
        {"latency_max_ms", in_ms(chain.latency_max)},
        {"last_minute",
         {{"frames", chain.lately.frames},
          {"missed", chain.lately.missed},
          {"median_ms", in_ms(chain.lately.median)},
          {"p99_ms", in_ms(chain.lately.p99)},
          {"max_ms", in_ms(chain.lately.max)}}},
        {"collisions",
         {{"looks", chain.collisions.looks}, {"collided", chain.collisions.collided}}},
        {"launches", chain.launches},
        {"holds", chain.holds},
        {"held_ms", in_ms(chain.held)},
        {"paced_ms", in_ms(chain.paced)},
        {"would_hold", chain.would_hold},
        {"would_held_ms", in_ms(chain.would_held)},
        {"would_wait_for", name_of_chain(page, chain.would_behind)},
        {"causes", causes_json(chain)},
        {"last_miss", last_miss_json(page, chain)}};
    json["tasks"] = nlohmann::ordered_json::array();
    for (const std::size_t index : chain.tasks)
        json["tasks"].push_back(task_json(page, page.tasks[index]));
    return json;
}

}  // namespace

nlohmann::ordered_json top_json(const std::vector<PageReading>& pages) {
    nlohmann::ordered_json root = {{"format_version", 1}};
    root["processes"] = nlohmann::ordered_json::array();
    for (const PageReading& page : pages) {
        nlohmann::ordered_json json = {
            {"pid", page.process.process},       {"program", page.program},
            {"process", to_word(page.liveness)}, {"mode", to_word(page.mode)},
            {"held_now", page.held_now},         {"dispatcher", dispatcher_json(page.dispatcher)}};
        if (page.cores) json["cores"] = *page.cores;
        if (page.overhead) json["overhead"] = *page.overhead;
        json["chains"] = nlohmann::ordered_json::array();
        for (const ChainReading& chain : page.chains)
            json["chains"].push_back(chain_json(page, chain));
        root["processes"].push_back(std::move(json));
    }
    return root;
}

}  // namespace urgengo::cli
