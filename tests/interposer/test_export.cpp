// SPDX-License-Identifier: Apache-2.0
//
// `urgengo export` beside a program under load, with an HTTP client that is as plain as can be.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <regex>

#include "host/base/file_descriptor.h"
#include "tests/interposer/steered.h"

using namespace urgengo;
using namespace urgengo::testing;

namespace {

Environment beside(const std::string& folder) {
    return {{"PATH", "/usr/bin:/bin"}, {"URGENGO_SHARE", folder}};
}

/// A port of loopback, which nobody else is given meanwhile.
struct Port {
    FileDescriptor socket{::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)};
    int port = 0;

    Port() {
        // A server that says so, too, may listen there, as long as this socket does not.
        const int on = 1;
        REQUIRE(setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) == 0);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
        socklen_t length = sizeof address;
        auto* const at = reinterpret_cast<sockaddr*>(&address);
        REQUIRE(bind(socket.get(), at, length) == 0);
        REQUIRE(getsockname(socket.get(), at, &length) == 0);
        port = ntohs(address.sin_port);
    }
};

/// One on which a socket listens.
struct Taken : Port {
    Taken() { REQUIRE(listen(socket.get(), 1) == 0); }
};

/// @returns the answer to GET /metrics; empty if no server is there within a while
std::string scrape(int port) {
    const nanoseconds end = monotonic_now() + kLongest;
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    while (monotonic_now() < end) {
        const FileDescriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
        if (connect(socket.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
            std::this_thread::sleep_for(5ms);
            continue;
        }
        const std::string request = "GET /metrics HTTP/1.0\r\n\r\n";
        REQUIRE(write(socket.get(), request.data(), request.size()) ==
                static_cast<ssize_t>(request.size()));
        std::string answer;
        char buffer[4096];
        for (ssize_t got; (got = read(socket.get(), buffer, sizeof buffer)) > 0;)
            answer.append(buffer, static_cast<std::size_t>(got));
        return answer;
    }
    return "";
}

/// @returns the sum of the metric's values over all of its labels that have that text
double sum_of(const std::string& text, const std::string& metric, const std::string& label = "") {
    double sum = 0;
    for (const std::string& line : lines_of(text)) {
        const std::size_t name = line.find_first_of("{ ");
        if (line.substr(0, name) == metric && line.find(label) != std::string::npos)
            sum += std::stod(line.substr(line.rfind(' ') + 1));
    }
    return sum;
}

}  // namespace

TEST_CASE("urgengo export prints the counts that a program's statistics tell at its exit",
          "[interposer][export]") {
    Steered program(config::Mode::kEnforce, 2ms);  // which is too short
    program.wait_for_frames(50);
    // From then on its counts stay as they are.
    program.steer(abi::ControlCommand::kOff);
    std::this_thread::sleep_for(50ms);
    const Outcome outcome = run({URGENGO_PATH, "export", "--once"}, beside(program.folder()));
    CHECK(outcome.err == "");
    REQUIRE(outcome.exit_status == 0);
    const std::string& text = outcome.out;
    REQUIRE(program.end().exit_status == 0);
    const nlohmann::json stats = program.stats();
    REQUIRE(stats.at("chains").size() == 4);
    for (const nlohmann::json& chain : stats.at("chains")) {
        const std::string label = "chain=\"" + chain.at("name").get<std::string>() + "\"";
        INFO(label);
        const auto is_told = [&](const std::string& metric, const char* field) {
            INFO(metric);
            CHECK(sum_of(text, metric, label) == chain.at(field).get<double>());
        };
        is_told("urgengo_frames_total", "instances");
        is_told("urgengo_frames_finished_total", "finished");
        is_told("urgengo_frames_exited_total", "exited");
        is_told("urgengo_consecutive_misses_max", "most_misses_in_a_row");
        is_told("urgengo_frame_latency_seconds_count", "finished");
        // Frames that were under way when it was switched off are dropped at its exit.
        CHECK(sum_of(text, "urgengo_frames_missed_total", label) <=
              chain.at("missed").get<double>());
        CHECK(sum_of(text, "urgengo_frames_missed_total", label) ==
              sum_of(text, "urgengo_frames_missed_by_cause_total", label));
        CHECK(sum_of(text, "urgengo_launches_total", label) > 0);
        CHECK(sum_of(text, "urgengo_frames_unread_total", label) == 0);
    }
    CHECK(sum_of(text, "urgengo_frames_missed_total") > 0);
    CHECK(sum_of(text, "urgengo_processes") == 1);
}

TEST_CASE("urgengo export serves processes that come and go, until a signal ends it",
          "[interposer][export]") {
    const Folder folder;
    const Port reserved;
    const int port = reserved.port;
    Environment environment = beside(folder.path().string());
    std::optional<Steered> program(std::in_place);
    environment["URGENGO_SHARE"] = program->folder();
    Running exporter({URGENGO_PATH, "export", "--listen", "127.0.0.1:" + std::to_string(port)},
                     environment);
    std::string first = scrape(port);
    // It listens a moment before it has what it serves.
    while (first.find("404 Not Found") != std::string::npos) first = scrape(port);
    CHECK(first.find("200 OK") != std::string::npos);
    CHECK(sum_of(first, "urgengo_frames_finished_total") > 0);
    // Each frame that has ended is in the histograms, give or take those that end meanwhile: more
    // where the thread that follows them has to wait for a core.
    const auto not_counted = [](const std::string& page) {
        return std::abs(sum_of(page, "urgengo_frame_latency_seconds_count") -
                        sum_of(page, "urgengo_frames_finished_total"));
    };
    for (int i = 0; i < 20 && not_counted(first) > 8; ++i) first = scrape(port);
    CHECK(not_counted(first) <= 8);
    program->wait_for_frames(20);
    const std::string second = scrape(port);
    CHECK(sum_of(second, "urgengo_frames_finished_total") >=
          sum_of(first, "urgengo_frames_finished_total") + 15);
    program->end();
    const std::string third = scrape(port);
    CHECK(third.find("200 OK") != std::string::npos);
    CHECK(sum_of(third, "urgengo_processes") == 0);
    CHECK(third.find("steered_0") == std::string::npos);
    kill(exporter.process(), GENERATE(SIGINT, SIGTERM));
    const Outcome outcome = exporter.wait();
    CHECK(outcome.exit_status == 0);
    CHECK(outcome.err == "urgengo: serves http://127.0.0.1:" + std::to_string(port) + "/metrics\n");
    CHECK(outcome.out == "");
}

TEST_CASE("urgengo export says what is wrong", "[interposer][export]") {
    const Folder folder;
    const auto run_export = [&](std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), {URGENGO_PATH, "export"});
        return run(arguments, beside(folder.path().string()));
    };
    const Taken taken;
    const std::string address = "127.0.0.1:" + std::to_string(taken.port);
    const Outcome refused = run_export({"--listen", address});
    CHECK(refused.exit_status == 1);
    CHECK(refused.err == "urgengo: cannot listen on " + address + ": Address already in use\n");
    CHECK(run_export({"--listen", "8080"}).exit_status == 2);
    CHECK(run_export({"--once", "--pid", "1"}).exit_status == 1);
    const Outcome empty = run_export({"--once"});
    CHECK(empty.exit_status == 0);
    CHECK(sum_of(empty.out, "urgengo_processes") == 0);
    CHECK(empty.out.find("# TYPE urgengo_processes gauge") != std::string::npos);
}
