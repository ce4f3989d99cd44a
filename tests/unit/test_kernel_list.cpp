// SPDX-License-Identifier: Apache-2.0
#include "host/observe/kernel_list.h"

#include "host/observe/status_page.h"
#include "tests/support/catch.h"
#include "tests/support/lidar_and_camera.h"

using namespace urgengo;
using namespace std::chrono_literals;
using observe::StatusPage;

namespace {

config::Config two_chains() {
    return testing::lidar_and_camera(80ms, 80ms, {{"detect", ""}, {"track", ""}});
}

}  // namespace

TEST_CASE("Status page has the launches of all plans, each kernel's name once, within its bounds",
          "[observe][status_page]") {
    config::Profile profile;
    profile.chains = {{"camera", {{}, {}}}, {"lidar", {{}}}};
    config::TaskProfile& track = profile.chains[0].tasks[0];
    track.name = "track";
    track.kernels = {{"conv", 1, 1, 5us, 1.0}, {"pool", 1, 1, 1h, 1.0}, {"conv", 2, 2, 7us, 1.0}};
    config::TaskProfile& detect = profile.chains[1].tasks[0];
    detect.name = "detect";
    detect.kernels = {{std::string(100, 'x'), 1, 1, 9us, 1.0}};
    SECTION("in the order of the tasks") {
        StatusPage page({}, two_chains(), 0s, &profile);
        const abi::StatusHeader& header = page.header();
        const char* const base = reinterpret_cast<const char*>(&header);
        const auto* const launches =
            reinterpret_cast<const abi::PlannedLaunch*>(base + header.launches.offset);
        const auto* const names =
            reinterpret_cast<const abi::KernelName*>(base + header.kernel_names.offset);
        REQUIRE(header.launches.count == 4);
        REQUIRE(header.kernel_names.count == 3);
        CHECK(page.task(0).first_launch == 1);
        CHECK(page.task(1).first_launch == 0);
        CHECK(page.task(2).first_launch == 0);
        CHECK(page.task(3).first_launch == 2);
        CHECK(launches[0].gpu_ns == 9000);
        CHECK(names[launches[0].name].name == std::string(abi::kNameBytes - 1, 'x'));
        CHECK(names[launches[1].name].name == std::string("conv"));
        CHECK(launches[2].gpu_ns == ~0u);  // as long as can be told
        CHECK(launches[3].name == launches[1].name);
        CHECK(header.kernel_names.offset + header.kernel_names.count * sizeof(abi::KernelName) <=
              header.file_bytes);
    }
    SECTION("no task that has no room, and no name") {
        profile.chains[0].tasks[1].name = "detect";
        profile.chains[0].tasks[1].kernels.assign(abi::kMostPlannedLaunches, {"k", 1, 1, 1us, 1.0});
        for (std::uint32_t i = 0; i < abi::kMostKernelNames; ++i)
            detect.kernels.push_back({"k" + std::to_string(i), 1, 1, 1us, 1.0});
        StatusPage page({}, two_chains(), 0s, &profile);
        CHECK(page.task(0).first_launch == 1);
        CHECK(page.task(2).first_launch == 0);
        CHECK(page.task(3).first_launch == detect.kernels.size() + 1);
        CHECK(page.header().kernel_names.count == abi::kMostKernelNames);
        CHECK(page.header().launches.count == detect.kernels.size() + track.kernels.size());
    }
}
