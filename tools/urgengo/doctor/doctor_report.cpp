// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/doctor_report.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <nlohmann/json.hpp>

namespace urgengo::cli {
namespace {

const char* word(Verdict verdict) {
    switch (verdict) {
        case Verdict::kOk:
            return "ok";
        case Verdict::kWarn:
            return "warn";
        case Verdict::kBad:
            break;
    }
    return "bad";
}

const char* conclusion(Verdict verdict) {
    switch (verdict) {
        case Verdict::kOk:
            return "UrgenGo can schedule here.";
        case Verdict::kWarn:
            return "UrgenGo can schedule here; mind the warnings.";
        case Verdict::kBad:
            break;
    }
    return "UrgenGo cannot schedule here: see what is bad.";
}

}  // namespace

void append(Findings& all, Findings more) {
    std::move(more.begin(), more.end(), std::back_inserter(all));
}

Verdict worst(const Findings& findings) {
    Verdict verdict = Verdict::kOk;
    for (const Finding& finding : findings) verdict = std::max(verdict, finding.verdict);
    return verdict;
}

std::string to_text(const Findings& findings) {
    std::size_t width = 0;
    for (const Finding& finding : findings) width = std::max(width, finding.topic.size());
    std::string text;
    for (const Finding& finding : findings) {
        text += fmt::format("{:<4}  {:<{}}  {}\n", word(finding.verdict), finding.topic, width,
                            finding.found);
    }
    return text + conclusion(worst(findings)) + "\n";
}

nlohmann::json to_json(const Findings& findings) {
    nlohmann::json list = nlohmann::json::array();
    for (const Finding& finding : findings) {
        list.push_back({{"topic", finding.topic},
                        {"verdict", word(finding.verdict)},
                        {"found", finding.found}});
    }
    return {{"verdict", word(worst(findings))}, {"findings", std::move(list)}};
}

}  // namespace urgengo::cli
