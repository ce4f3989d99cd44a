// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/doctor/priority_probe.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "host/base/atomic_file.h"
#include "host/base/hash.h"
#include "host/config/file_text.h"
#include "host/config/json_cursor.h"
#include "tools/urgengo/doctor/driver_question.h"
#include "urgengo_build_info.h"

namespace urgengo::cli {
namespace {

namespace fs = std::filesystem;
using config::JsonCursor;
using Json = nlohmann::json;

constexpr std::int64_t kFormatVersion = 1;
constexpr int kMaxLevel = 1000;  // far beyond any driver's
constexpr double kMaxUs = 1e9;
constexpr char kProblemMark = '-';  // first byte of a child's answer that is none

struct HonouredWord {
    const char* word;
    Honoured value;
};
constexpr HonouredWord kHonoured[] = {
    {"honoured", Honoured::kYes}, {"ignored", Honoured::kNo}, {"refused", Honoured::kRefused}};

Json to_json(const PriorityWait& wait) {
    return {{"us", wait.us}, {"behind_us", wait.behind_us}};
}

PriorityWait wait_from_json(const JsonCursor& json) {
    return {json.at("us").number(0, kMaxUs), json.at("behind_us").number(0, kMaxUs)};
}

Json to_json(const PriorityWay& way) {
    const auto* word = std::find_if(std::begin(kHonoured), std::end(kHonoured),
                                    [&](const auto& w) { return w.value == way.honoured; });
    return {{"found", word->word}, {"wait", to_json(way.wait)}};
}

PriorityWay way_from_json(const JsonCursor& json) {
    const JsonCursor found = json.at("found");
    const std::string text = found.text();
    const auto* word = std::find_if(std::begin(kHonoured), std::end(kHonoured),
                                    [&](const auto& w) { return w.word == text; });
    const bool known = word != std::end(kHonoured);
    if (!known) found.fail("one of honoured, ignored, refused");
    return {known ? word->value : Honoured::kRefused, wait_from_json(json.at("wait"))};
}

Json measurement_to_json(const PriorityMeasurement& m) {
    return {{"least", m.least},
            {"greatest", m.greatest},
            {"busy_us", m.busy_us},
            {"plain", to_json(m.plain)},
            {"launch_attribute", to_json(m.launch_attribute)},
            {"stream_attribute", to_json(m.stream_attribute)},
            {"stream", to_json(m.stream)}};
}

PriorityMeasurement measurement_from_json(const JsonCursor& json) {
    PriorityMeasurement m;
    m.least = static_cast<int>(json.at("least").integer(-kMaxLevel, kMaxLevel));
    m.greatest = static_cast<int>(json.at("greatest").integer(-kMaxLevel, kMaxLevel));
    m.busy_us = json.at("busy_us").number(0, kMaxUs);
    m.plain = wait_from_json(json.at("plain"));
    m.launch_attribute = way_from_json(json.at("launch_attribute"));
    m.stream_attribute = way_from_json(json.at("stream_attribute"));
    m.stream = way_from_json(json.at("stream"));
    return m;
}

std::string dump(const Json& json) {
    // A GPU's name need not be UTF-8; replacing is better than throwing.
    return json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

/// The driver's release, which its file's name ends in: libcuda.so.580.95.05.
std::string release_of(const std::string& library) {
    std::error_code error;
    const std::string name = fs::canonical(library, error).filename().string();
    constexpr std::string_view kPrefix = "libcuda.so.";
    const std::string release = name.starts_with(kPrefix) ? name.substr(kPrefix.size()) : "";
    return release.find('.') == std::string::npos ? "" : release;  // not of libcuda.so.1
}

}  // namespace

PriorityKey priority_key(const std::string& gpu, const std::string& driver,
                         const std::string& library) {
    const std::string release = release_of(library);
    return {gpu, release.empty() ? driver : driver + " " + release,
            fmt::format("{} ({})", kVersion, kCommit)};
}

Result<PriorityMeasurement> probe_priority(const std::string& library,
                                           std::chrono::milliseconds limit) {
    const auto answer = ask_in_child(
        [&] {
            const auto measured = measure_priority(library);
            return measured ? priority_json(*measured) : kProblemMark + measured.error();
        },
        limit);
    if (!answer) return Error{answer.error()};
    if (answer->starts_with(kProblemMark)) return Error{answer->substr(1)};
    return parse_priority_json(*answer, "priority probe");
}

std::string PriorityCache::path(const PriorityKey& key) const {
    if (folder_.empty()) return {};
    const std::string text = key.gpu + "\n" + key.driver + "\n" + key.urgengo;
    return fmt::format("{}/priority-{:016x}.json", folder_, fnv1a64(text));
}

Result<PriorityMeasurement> PriorityCache::find(const PriorityKey& key) const {
    if (folder_.empty()) return Error{"there is no cache folder"};
    const std::string file = path(key);
    const auto text = config::read_file(file);
    if (!text) return Error{text.error()};
    const auto root = config::parse_json(*text, file);
    if (!root) return Error{root.error()};
    config::JsonFault fault{file, {}};
    const JsonCursor json(*root, fault);
    json.at("format_version").integer(kFormatVersion, kFormatVersion);
    const bool is_of_key = json.at("gpu").text() == key.gpu &&
                           json.at("driver").text() == key.driver &&
                           json.at("urgengo").text() == key.urgengo;
    const PriorityMeasurement measured = measurement_from_json(json.at("priority"));
    if (!fault.message.empty()) return Error{fault.message};
    if (!is_of_key) return Error{file + ": is of another GPU, driver or version"};
    return measured;
}

Result<bool> PriorityCache::store(const PriorityKey& key,
                                  const PriorityMeasurement& measured) const {
    if (folder_.empty()) return Error{"there is no cache folder"};
    std::error_code error;
    fs::create_directories(folder_, error);
    if (error) return Error{folder_ + ": cannot be made: " + error.message()};
    return write_file_atomically(path(key), dump({{"format_version", kFormatVersion},
                                                  {"gpu", key.gpu},
                                                  {"driver", key.driver},
                                                  {"urgengo", key.urgengo},
                                                  {"priority", measurement_to_json(measured)}}));
}

std::string describe(const PriorityWay& way) {
    if (way.honoured == Honoured::kRefused) return "refused by the driver";
    return fmt::format("{} (waited {:.0f} us behind {:.0f} us of other work)",
                       way.honoured == Honoured::kYes ? "honoured" : "ignored", way.wait.us,
                       way.wait.behind_us);
}

PriorityChoice choose_priority(const Result<PriorityMeasurement>& measured) {
    using config::PriorityVia;
    if (!measured) {
        return {PriorityVia::kLaunchAttribute, "not measured (" + measured.error() + ")"};
    }
    const PriorityWay& launch = measured->launch_attribute;
    const PriorityWay& stream = measured->stream_attribute;
    const std::string by_launch = "on a launch " + describe(launch);
    if (launch.honoured == Honoured::kYes) return {PriorityVia::kLaunchAttribute, by_launch};
    const std::string by_stream = by_launch + ", on a stream " + describe(stream);
    if (stream.honoured == Honoured::kYes) return {PriorityVia::kStreamAttribute, by_stream};
    return {PriorityVia::kStreamPool, by_stream};
}

std::string priority_json(const PriorityMeasurement& measured) {
    return dump(measurement_to_json(measured));
}

Result<PriorityMeasurement> parse_priority_json(std::string_view text, const std::string& file) {
    const auto root = config::parse_json(text, file);
    if (!root) return Error{root.error()};
    config::JsonFault fault{file, {}};
    const PriorityMeasurement measured = measurement_from_json(JsonCursor(*root, fault));
    if (!fault.message.empty()) return Error{fault.message};
    return measured;
}

}  // namespace urgengo::cli
