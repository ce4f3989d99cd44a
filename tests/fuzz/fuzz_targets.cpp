// SPDX-License-Identifier: Apache-2.0
#include "tests/fuzz/fuzz_targets.h"

#include <string>
#include <string_view>

#include "host/config/config_reader.h"
#include "host/config/profile_reader.h"
#include "host/config/resolved_config.h"
#include "tools/trace/trace_reader.h"
#include "tools/urgengo/page/page_reader.h"
#include "tools/urgengo/top/top_view.h"

namespace urgengo::fuzz {
namespace {

std::string_view text_of(Input input) {
    return {reinterpret_cast<const char*>(input.data()), input.size()};
}

}  // namespace

void page(Input input) {
    const auto page = cli::parse_page(input, std::chrono::seconds(3));
    if (!page) return;
    cli::TopOptions options;
    options.tasks = true;
    (void)cli::top_lines({*page}, options);
    (void)cli::top_json({*page}).dump();
}

void trace(Input input) {
    const auto trace = trace::parse_trace(text_of(input), "trace");
    if (!trace) return;
    (void)trace->gpu();
    (void)trace->driver();
    for (const trace::ThreadTrace& thread : trace->threads())
        for (const abi::TraceRecord* record : thread.events) {
            (void)thread.name_at(record->time_ns);
            if (record->kind == abi::TraceKind::kLaunch) (void)launch_name(*trace, *record);
        }
}

void config(Input input) {
    (void)config::parse_config(std::string(text_of(input)), "chains.yaml", "");
}

void profile(Input input) {
    (void)config::parse_profile(text_of(input), "profile");
}

void resolved(Input input) {
    const auto resolved = config::parse_resolved_json(text_of(input), "resolved");
    if (!resolved) return;
    // What has been read can be written, and read again.
    const config::Profile* const profile = resolved->profile ? &*resolved->profile : nullptr;
    const std::string text = config::to_resolved_json(resolved->config, profile, resolved->source);
    if (!config::parse_resolved_json(text, "written")) __builtin_trap();
}

}  // namespace urgengo::fuzz
