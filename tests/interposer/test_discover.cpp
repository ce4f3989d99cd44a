// SPDX-License-Identifier: Apache-2.0
//
// urgengo discover and urgengo check from end to end, against the simulated GPU.
#include "tests/interposer/run_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

namespace {

Outcome urgengo_cli(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), URGENGO_PATH);
    return run(arguments, {{"PATH", "/usr/bin:/bin"},
                           {"LD_LIBRARY_PATH", SIMGPU_FOLDER},
                           {"TWIN_SIMGPU", SIMGPU_FOLDER "/libcuda.so.1"}});
}

bool has(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
}

}  // namespace

TEST_CASE("Draft is valid and check finds every chain of it when a program was discovered",
          "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "draft.yaml").string();
    const std::vector<std::string> program = {"--", TWIN_PATH, "periodic"};
    std::vector<std::string> discover = {"discover", "-o", yaml, "--keep-trace"};
    discover.insert(discover.end(), program.begin(), program.end());

    const Outcome discovered = urgengo_cli(discover);
    INFO(discovered.err);
    REQUIRE(discovered.exit_status == 0);
    CHECK(discovered.out == "done\n");  // the program's, and nothing of ours
    const std::string draft = read_text(yaml);
    INFO(draft);
    CHECK(has(draft, "{name: \"sensor\", thread: \"sensor\"}"));
    CHECK(has(draft, "{name: \"points\", kernels: \"points\"}"));
    CHECK(has(draft, "{name: \"image\", kernels: \"image\"}"));
    CHECK(std::filesystem::exists(folder.path() / "draft.ugtrace"));

    // A draft is somebody's work once it has been edited.
    CHECK(urgengo_cli(discover).err == "urgengo: " + yaml +
                                           ": found a file, accepted: another name (-o FILE), or "
                                           "--force to replace it\n");

    std::vector<std::string> check = {"check", "-c", yaml};
    check.insert(check.end(), program.begin(), program.end());
    const Outcome checked = urgengo_cli(check);
    INFO(checked.out);
    INFO(checked.err);
    CHECK(checked.exit_status == 0);
    CHECK(has(checked.out, "done\n"));
    for (const char* task : {"sensor/sensor", "points/points", "image/image"}) {
        CHECK(has(checked.out, task));
    }
    CHECK_FALSE(has(checked.out, "NOTHING"));

    // The draft is good for a run as it stands.
    std::vector<std::string> run_it = {"run", "-c", yaml};
    run_it.insert(run_it.end(), program.begin(), program.end());
    const Outcome ran = urgengo_cli(run_it);
    CHECK(ran.exit_status == 0);
    CHECK(ran.out == "done\n");
}

TEST_CASE("Check fails with the names that were seen when a task matches nothing",
          "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "c.yaml").string();
    write_text(yaml,
               "version: 1\nchains:\n  - {name: a, period_ms: 20, deadline_ms: 20, "
               "tasks: [{name: t, thread: \"sensr\"}]}\n");
    const Outcome checked = urgengo_cli({"check", "-c", yaml, "--", TWIN_PATH, "periodic"});
    CHECK(checked.exit_status == 1);
    CHECK(has(checked.out, "Nothing matched a/t:\n  thread: found twin ("));
    CHECK(has(checked.out, "accepted: sensr\n"));
    CHECK(has(checked.out, "GPU time that no task explains: "));
}

TEST_CASE("Discover says what it needs when the program or its driver is of no use",
          "[interposer][discover]") {
    const Folder folder;
    const std::string yaml = (folder.path() / "d.yaml").string();
    const Outcome no_cuda = urgengo_cli({"discover", "-o", yaml, "--", TWIN_PATH, "no_cuda"});
    CHECK(no_cuda.exit_status == 1);
    CHECK(has(no_cuda.err, "no trace was written: it made no CUDA call"));
    const Outcome too_short = urgengo_cli({"discover", "-o", yaml, "--", TWIN_PATH, "copies"});
    CHECK(too_short.exit_status == 1);
    CHECK(has(too_short.err, "found nothing that the program does periodically on the GPU"));
    CHECK_FALSE(std::filesystem::exists(yaml));
    const Outcome no_gpu = run({URGENGO_PATH, "discover", "-o", yaml, "--real-libcuda",
                                "/nonexistent/libcuda.so.1", "--", TWIN_PATH, "periodic"},
                               {{"PATH", "/usr/bin:/bin"}});
    CHECK(no_gpu.exit_status == 1);
    CHECK(has(no_gpu.err, "urgengo: found no GPU, accepted: one that the driver can use ("));
    CHECK(urgengo_cli({"discover"}).err ==
          "urgengo: no program, accepted: urgengo discover [options] -- program [args...], or "
          "--trace FILE of a program that was watched before\n");
    CHECK(urgengo_cli({"check", "-c", yaml}).exit_status == 2);
}
