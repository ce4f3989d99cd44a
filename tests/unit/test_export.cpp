// SPDX-License-Identifier: Apache-2.0
#include <prometheus/text_serializer.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>

#include "host/base/clock.h"
#include "host/observe/status_page.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tests/support/lidar_and_camera.h"
#include "tools/urgengo/cmd_export.h"
#include "tools/urgengo/export/metrics.h"
#include "tools/urgengo/export/page_collector.h"

using namespace urgengo;
using namespace std::chrono_literals;
using cli::FrameFollower;
using cli::PageCollector;
using prometheus::ClientMetric;
using prometheus::MetricFamily;
using std::chrono::nanoseconds;
using Folder = testing::MemoryFolder;

namespace {

config::Config two_chains() {
    return testing::lidar_and_camera(50ms, 50ms, {{"detect", ""}});
}

struct ExportedPage {
    Folder folder;
    observe::StatusPage page{{folder.path().string(), ""}, two_chains(), 1s};

    std::string path() const { return folder.path().string(); }
    /// The camera's next frames end.
    void end_frames(int count, nanoseconds latency) {
        abi::ChainStatus& chain = page.chain(1);
        for (; count > 0; --count) {
            const std::uint64_t number = chain.frames;
            abi::FrameRecord& frame = chain.ring[number % abi::kFrameRing];
            frame.latency_us = static_cast<std::uint32_t>(latency / 1us);
            frame.cause = latency > 50ms ? static_cast<std::uint16_t>(abi::MissCause::kHeld) : 0;
            chain.frames = number + 1;
        }
    }
    std::unique_ptr<FrameFollower> follower() const { return FrameFollower::open(page.stem()); }
};

/// @returns the metric with these labels among others; null: there is none
const ClientMetric* find(const std::vector<MetricFamily>& families, const std::string& name,
                         const std::map<std::string, std::string>& labels) {
    for (const MetricFamily& family : families) {
        if (family.name != name) continue;
        for (const ClientMetric& metric : family.metric) {
            std::size_t same = 0;
            for (const auto& label : metric.label)
                same += labels.count(label.name) != 0 && labels.at(label.name) == label.value;
            if (same == labels.size()) return &metric;
        }
    }
    return nullptr;
}

std::uint64_t below(const ClientMetric::Histogram& histogram, double bound) {
    for (const auto& bucket : histogram.bucket)
        if (std::abs(bucket.upper_bound - bound) < 1e-9) return bucket.cumulative_count;
    FAIL("no bucket " << bound);
    return 0;
}

}  // namespace

TEST_CASE("Frames that end are counted once, however often the ring is looked at",
          "[cli][export]") {
    ExportedPage f;
    const auto follower = f.follower();
    REQUIRE(follower);
    const int at_once = GENERATE(1, 7, 512, 900);
    int ended = 0;
    for (int i = 0; i < 5; ++i) {
        f.end_frames(at_once, 20ms);
        ended += at_once;
        follower->follow();
        follower->follow();
        CHECK(follower->chains()[1].latency.total() == static_cast<std::uint64_t>(ended));
    }
    CHECK(follower->chains()[1].unread == 0);
    CHECK(follower->chains()[1].latency.sum() == ended * 20ms);
    CHECK(follower->chains()[0].latency.total() == 0);
}

TEST_CASE("Frames that were written over before they were seen are counted as unread",
          "[cli][export]") {
    ExportedPage f;
    SECTION("when the follower came late") {
        f.end_frames(5000, 20ms);
        const auto follower = f.follower();
        follower->follow();
        CHECK(follower->chains()[1].unread > 5000 - abi::kFrameRing);
        CHECK(follower->chains()[1].unread + follower->chains()[1].latency.total() == 5000);
    }
    SECTION("when too many ended between two looks") {
        const auto follower = f.follower();
        f.end_frames(100, 20ms);
        follower->follow();
        f.end_frames(3000, 20ms);
        follower->follow();
        CHECK(follower->chains()[1].unread > 0);
        CHECK(follower->chains()[1].unread + follower->chains()[1].latency.total() == 3100);
    }
    SECTION("when a page says that there were more than can have been") {
        f.page.chain(1).frames = ~std::uint64_t{0};
        const auto follower = f.follower();
        follower->follow();
        follower->follow();
        CHECK(follower->chains()[1].latency.total() <= abi::kFrameRing);
    }
}

TEST_CASE("Histograms tell latency, and lateness of late frames alone", "[cli][export]") {
    ExportedPage f;
    f.end_frames(3, 20ms);
    f.end_frames(2, 50ms);        // in time
    f.end_frames(1, 50ms + 1us);  // late
    f.end_frames(4, 50ms + 3ms);
    f.end_frames(1, 100s);
    const auto families = PageCollector(f.path(), 0).Collect();
    const ClientMetric* const latency =
        find(families, "urgengo_frame_latency_seconds", {{"chain", "camera"}});
    REQUIRE(latency);
    CHECK(latency->histogram.sample_count == 11);
    CHECK(below(latency->histogram, 0.015) == 0);
    CHECK(below(latency->histogram, 0.02) == 3);
    CHECK(below(latency->histogram, 0.05) == 5);
    CHECK(below(latency->histogram, 0.06) == 10);
    CHECK(below(latency->histogram, 5) == 10);
    CHECK(std::abs(latency->histogram.sample_sum - (0.06 + 0.1 + 0.050001 + 0.212 + 100)) < 1e-6);
    const ClientMetric* const lateness =
        find(families, "urgengo_frame_lateness_seconds", {{"chain", "camera"}});
    REQUIRE(lateness);
    CHECK(below(lateness->histogram, 0) == 5);
    CHECK(below(lateness->histogram, 0.001) == 6);
    CHECK(below(lateness->histogram, 0.005) == 10);
    CHECK(lateness->histogram.sample_count == 11);
}

TEST_CASE("Metrics tell what the page tells", "[cli][export]") {
    ExportedPage f;
    f.page.set_mode(config::Mode::kEnforce);
    abi::ChainStatus& chain = f.page.chain(1);
    chain.instances = 12;
    chain.finished = 10;
    chain.missed = 3;
    chain.causes[static_cast<std::size_t>(abi::MissCause::kHeld)] = 2;
    chain.causes[static_cast<std::size_t>(abi::MissCause::kDropped)] = 1;
    chain.causes[abi::kCauseCounters - 1] = 4;  // of a later version
    chain.misses_in_a_row = 2;
    chain.most_misses_in_a_row = 5;
    chain.holds = 7;
    chain.held_ns = 1'500'000'000;
    chain.paced_ns = 250'000'000;
    chain.launches = 100;
    chain.guard = 1;
    f.page.akb().tasks[1].factor_ppm = 1'250'000;
    f.page.akb().tasks[0].state = abi::TaskState::kHeld;
    const std::map<std::string, std::string> camera{{"chain", "camera"},
                                                    {"pid", std::to_string(getpid())}};
    const auto families = PageCollector(f.path(), 0).Collect();
    const auto counter = [&](const char* name, std::map<std::string, std::string> labels) {
        const ClientMetric* const metric = find(families, name, labels);
        return metric ? metric->counter.value : -1;
    };
    const auto gauge = [&](const char* name, std::map<std::string, std::string> labels) {
        const ClientMetric* const metric = find(families, name, labels);
        return metric ? metric->gauge.value : -1;
    };
    const auto camera_with = [&](const char* label, const char* value) {
        auto labels = camera;
        labels[label] = value;
        return labels;
    };
    CHECK(gauge("urgengo_processes", {}) == 1);
    CHECK(counter("urgengo_frames_total", camera) == 12);
    CHECK(counter("urgengo_frames_total", {{"chain", "lidar"}}) == 0);
    CHECK(counter("urgengo_frames_finished_total", camera) == 10);
    CHECK(counter("urgengo_frames_missed_total", camera) == 3);
    const char* const by_cause = "urgengo_frames_missed_by_cause_total";
    CHECK(counter(by_cause, camera_with("cause", "held")) == 2);
    CHECK(counter(by_cause, camera_with("cause", "dropped")) == 1);
    CHECK(counter(by_cause, camera_with("cause", "shared")) == 0);
    CHECK(counter(by_cause, camera_with("cause", "outside")) == 4);
    CHECK(gauge("urgengo_consecutive_misses", camera) == 2);
    CHECK(gauge("urgengo_consecutive_misses_max", camera) == 5);
    CHECK(counter("urgengo_holds_total", camera) == 7);
    CHECK(counter("urgengo_held_seconds_total", camera) == 1.5);
    CHECK(counter("urgengo_paced_seconds_total", camera) == 0.25);
    CHECK(counter("urgengo_launches_total", camera) == 100);
    CHECK(gauge("urgengo_guard", camera_with("way", "priorities")) == 1);
    CHECK(gauge("urgengo_guard", camera_with("way", "enforce")) == 0);
    CHECK(gauge("urgengo_estimate_factor", camera_with("task", "detect")) == 1.25);
    CHECK(gauge("urgengo_estimate_factor", {{"chain", "lidar"}, {"task", "detect"}}) == 1);
    CHECK(gauge("urgengo_deadline_seconds", camera) == 0.05);
    CHECK(gauge("urgengo_period_seconds", camera) == 0.1);
    CHECK(gauge("urgengo_mode", {{"mode", "enforce"}}) == 1);
    CHECK(gauge("urgengo_mode", {{"mode", "tripped"}}) == 0);
    CHECK(gauge("urgengo_mode", {{"mode", "shadow"}}) == 0);
    CHECK(counter("urgengo_trips_total", {}) == 0);
    f.page.set_mode(config::Mode::kShadow);
    const auto shadow = PageCollector(f.path(), 0).Collect();
    CHECK(find(shadow, "urgengo_mode", {{"mode", "shadow"}})->gauge.value == 1);
    CHECK(find(shadow, "urgengo_mode", {{"mode", "enforce"}})->gauge.value == 0);
    f.page.tripped();
    const auto tripped = PageCollector(f.path(), 0).Collect();
    CHECK(find(tripped, "urgengo_trips_total", {})->counter.value == 1);
    CHECK(find(tripped, "urgengo_mode", {{"mode", "tripped"}})->gauge.value == 1);
}

TEST_CASE("Process that ends leaves the metrics, and one that starts comes in", "[cli][export]") {
    const Folder folder;
    const PageCollector collector(folder.path().string(), 0);
    const auto processes = [&] {
        return find(collector.Collect(), "urgengo_processes", {})->gauge.value;
    };
    CHECK(processes() == 0);
    CHECK(collector.Collect().size() == 1);
    for (int i = 0; i < 2; ++i) {
        observe::StatusPage page{{folder.path().string(), ""}, two_chains(), 1s};
        abi::ChainStatus& chain = page.chain(0);
        chain.frames = 1;
        const auto families = collector.Collect();
        CHECK(find(families, "urgengo_processes", {})->gauge.value == 1);
        // The second has the name of the first, and none of its frames.
        CHECK(find(families, "urgengo_frame_latency_seconds", {{"chain", "lidar"}})
                  ->histogram.sample_count == 1);
        page.retire();
        CHECK(processes() == 0);
    }
}

TEST_CASE("No two metrics have the same labels, and names are those of Prometheus",
          "[cli][export]") {
    ExportedPage f;
    std::strcpy(f.page.chain(0).name, "camera");
    std::strcpy(f.page.header().program, "a\"b\\c");
    const auto families = PageCollector(f.path(), 0).Collect();
    std::set<std::string> seen;
    for (const MetricFamily& family : families) {
        CHECK(std::regex_match(family.name, std::regex("urgengo_[a-z_]+")));
        CHECK_FALSE(family.help.empty());
        CHECK((family.type == prometheus::MetricType::Counter) ==
              std::regex_search(family.name, std::regex("_total$")));
        for (const ClientMetric& metric : family.metric) {
            std::string labels = family.name;
            for (const auto& label : metric.label) labels += "," + label.name + "=" + label.value;
            CHECK(seen.insert(labels).second);
        }
    }
    const std::string text = prometheus::TextSerializer().Serialize(families);
    CHECK(text.find("program=\"a\\\"b\\\\c\"") != std::string::npos);
    CHECK(text.find("chain=\"camera (2)\"") != std::string::npos);
}

TEST_CASE("Metrics are documented, and each that the dashboard shows is exported",
          "[cli][export]") {
    ExportedPage f;
    std::set<std::string> exported;
    for (const MetricFamily& family : PageCollector(f.path(), 0).Collect())
        exported.insert(family.name);
    const auto text_of = [](const std::string& file) {
        std::ifstream stream(std::string(URGENGO_SOURCE) + file);
        return std::string{std::istreambuf_iterator<char>(stream), {}};
    };
    const std::string documented = text_of("/docs/configuration.md");
    for (const std::string& name : exported) {
        INFO(name);
        CHECK(documented.find("`" + name + "`") != std::string::npos);
    }
    const std::string dashboard = text_of("/docs/grafana/urgengo.json");
    std::size_t exprs = 0;
    const std::function<void(const nlohmann::json&)> check = [&](const nlohmann::json& json) {
        for (const auto& [key, value] : json.items()) {
            if (value.is_structured()) check(value);
            if ((key != "expr" && key != "definition") || !value.is_string()) continue;
            ++exprs;
            const auto expr = value.get<std::string>();
            const std::regex metric("urgengo_[a-z_]+");
            for (std::sregex_iterator at(expr.begin(), expr.end(), metric), end; at != end; ++at) {
                const std::string name =
                    std::regex_replace(at->str(), std::regex("_(bucket|sum|count)$"), "");
                INFO(at->str());
                CHECK(exported.count(name) == 1);
            }
        }
    };
    check(nlohmann::json::parse(dashboard));
    CHECK(exprs > 10);
}

TEST_CASE("Address to listen on has a port, and brackets around IPv6", "[cli][export]") {
    const auto host = [](const char* text) {
        const auto address = cli::parse_address(text);
        return address ? address->host_in_url() + " " + address->port : "";
    };
    CHECK(host("127.0.0.1:9865") == "127.0.0.1 9865");
    CHECK(host("[::1]:0") == "[::1] 0");
    CHECK(host(":80") == "0.0.0.0 80");
    for (const char* text : {"", "9865", "127.0.0.1", "127.0.0.1:", "127.0.0.1:70000", "::1:80",
                             "127.0.0.1:80s", "127.0.0.1:80,8080", "somewhere:80", "[1.2.3.4]:5"})
        CHECK(host(text) == "");
}
