// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/doctor_program.h"

#include <filesystem>

#include "tools/urgengo/program/program_check.h"
#include "tools/urgengo/program/program_setup.h"

namespace urgengo::cli {

Findings check_library(const Result<std::string>& interposer) {
    const char* const topic = "UrgenGo's library";
    if (!interposer) return {{topic, Verdict::kBad, interposer.error()}};
    const std::string wrong = why_not_preloadable_from(*interposer);
    if (!wrong.empty()) return {{topic, Verdict::kBad, wrong}};
    return {{topic, Verdict::kOk, *interposer}};
}

ProgramFindings check_program_file(const std::vector<std::string>& program,
                                   const Environment& environment) {
    const char* const topic = "program";
    if (program.empty()) return {};
    const FoundProgram found = find_program(program.front(), value_of(environment, "PATH"));
    if (found.path.empty()) return {{{topic, Verdict::kBad, found.message}}, "", ""};
    const ProgramCheck check = check_program(found.path, program_user(environment));
    const std::string name = std::filesystem::path(found.path).filename().string();
    if (!check.refusal.empty()) return {{{topic, Verdict::kBad, check.refusal}}, name, ""};
    ProgramFindings result{{}, name, check.driver};
    const bool is_script = check.file != found.path;
    result.findings.push_back(
        {topic, Verdict::kOk,
         found.path + (is_script ? ", run by " + check.file : "") + ": its calls would be seen"});
    for (const std::string& warning : check.warnings) {
        result.findings.push_back({topic, Verdict::kWarn, warning});
    }
    return result;
}

}  // namespace urgengo::cli
