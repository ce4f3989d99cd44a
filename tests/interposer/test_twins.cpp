// SPDX-License-Identifier: Apache-2.0
//
// Programs that do the same when UrgenGo is loaded.
#include "tests/interposer/check_twin.h"
#include "tests/support/catch.h"

using namespace urgengo::testing;

TEST_CASE("Copies and memsets give the same data when UrgenGo is loaded", "[interposer][twins]") {
    check_twin({"copies"});
}

TEST_CASE("Copies and memsets of every shape keep their place when launches around them are held",
          "[interposer][twins]") {
    check_twin({"linear_copies"});
    check_twin({"shaped_copies"});
    check_twin({"array_copies"});
    check_twin({"batch_copies"});
}

TEST_CASE("Every kind of stream gives the same data when UrgenGo is loaded",
          "[interposer][twins]") {
    check_twin({"streams"});
}

TEST_CASE("Per-thread entry points give the same data when UrgenGo is loaded",
          "[interposer][twins]") {
    Scenario scenario{"per_thread"};
    scenario.shows_streams = true;
    check_twin(scenario);
}

TEST_CASE("Modules work the same when they are unloaded and loaded again", "[interposer][twins]") {
    check_twin({"modules"});
}

TEST_CASE("Refused calls have the same results when UrgenGo is loaded", "[interposer][twins]") {
    check_twin({"errors"});
}

TEST_CASE("Calls have the same results when the driver is not initialised", "[interposer][twins]") {
    check_twin({"too_early"});
}

TEST_CASE("Launch attributes have the same effect when UrgenGo adds its own",
          "[interposer][twins]") {
    check_twin({"attributes"});
}

TEST_CASE("Streams have their own priority when their launches were scheduled",
          "[interposer][twins]") {
    check_twin({"priorities"});
}

TEST_CASE("Calls that wait for all GPU work do the same when UrgenGo is loaded",
          "[interposer][twins]") {
    check_twin({"implicit_waits"});
}

TEST_CASE("Current context is the program's own when UrgenGo works in it", "[interposer][twins]") {
    check_twin({"current_context"});
}

TEST_CASE("Several contexts work the same when UrgenGo is loaded", "[interposer][twins]") {
    check_twin({"two_contexts"});
}

TEST_CASE("Contexts work the same when they are destroyed and made again", "[interposer][twins]") {
    check_twin({"recreated_contexts"});
}

TEST_CASE("Contexts work the same when they are attached to and detached from",
          "[interposer][twins]") {
    check_twin({"attached_contexts"});
}

TEST_CASE("Second device is left alone when the first one's work is scheduled",
          "[interposer][twins]") {
    Scenario scenario{"devices"};
    scenario.environment = {{"SIMGPU_DEVICES", "2"}};
    scenario.holds = true;
    check_twin(scenario);
}

TEST_CASE("Captures see the program's own work only when other threads launch",
          "[interposer][twins][graphs]") {
    check_twin({"capture_busy"});
}

TEST_CASE("Captures stay valid when UrgenGo starts, or enters a context, meanwhile",
          "[interposer][twins][graphs]") {
    check_twin({"capture_first_launch"});
}

TEST_CASE("Default streams capture and are refused as usual when UrgenGo is loaded",
          "[interposer][twins][graphs]") {
    check_twin({"capture_implicit"});
}

TEST_CASE("Captures over several streams are the same when UrgenGo is loaded",
          "[interposer][twins][graphs]") {
    check_twin({"capture_joined"});
}

TEST_CASE("Graphs run the same when they are updated and cloned", "[interposer][twins][graphs]") {
    check_twin({"graph_updates"});
}

TEST_CASE("Graphs run the same when they have children, memory and conditions",
          "[interposer][twins][graphs]") {
    check_twin({"graph_nodes"});
}

TEST_CASE("Graphs run the same when they are launched on every kind of stream",
          "[interposer][twins][graphs]") {
    check_twin({"graph_streams"});
}

TEST_CASE("Graph runs the same when its launch is held", "[interposer][twins][graphs]") {
    Scenario scenario{"graph_held"};
    scenario.holds = true;
    check_twin(scenario);
}

TEST_CASE("Nodes keep their own priorities when their streams were scheduled",
          "[interposer][twins][graphs]") {
    check_twin({"graph_node_priorities"});
}

TEST_CASE("Many threads give the same results when their launches are scheduled",
          "[interposer][twins]") {
    check_twin({"threads"});
}

TEST_CASE("Threads give the same results when they change their names", "[interposer][twins]") {
    check_twin({"renamed_threads"});
}

TEST_CASE("Threads give the same results when they end with work under way",
          "[interposer][twins]") {
    check_twin({"short_threads"});
}

// The sanitizers themselves abort when a cancelled thread unwinds, bare too.
#if !SANITIZED
TEST_CASE("Thread is cancelled as usual when it waits in a call", "[interposer][twins]") {
    check_twin({"cancel_waiting"});
}

TEST_CASE("Thread is cancelled as usual when its launch is held", "[interposer][twins]") {
    Scenario scenario{"cancel_held"};
    scenario.holds = true;
    check_twin(scenario);
}
#endif

TEST_CASE("Program is left alone when it never calls CUDA", "[interposer][twins]") {
    Scenario scenario{"no_cuda"};
    scenario.starts = 0;
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Program without a GPU to use sees the same when UrgenGo is loaded",
          "[interposer][twins]") {
    Scenario scenario{"init"};
    scenario.reports = false;  // its one launch fails
    check_twin(scenario);
}

TEST_CASE("Forked child and its parent go on when UrgenGo is loaded", "[interposer][twins]") {
    // Both the first child, forked before the first launch, and the parent launch.
    Scenario scenario{"fork"};
    scenario.starts = 2;
    check_twin(scenario);
}

TEST_CASE("Program sees the same when it executes itself", "[interposer][twins]") {
    Scenario scenario{"exec"};
    scenario.starts = 2;
    check_twin(scenario);
}

TEST_CASE("Program exits as usual when work is pending", "[interposer][twins]") {
    check_twin({"exit_pending", 3});
}

TEST_CASE("Program ends at once when it calls _exit with work pending", "[interposer][twins]") {
    Scenario scenario{"exit_at_once", 4};
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Program exits as usual when other threads launch", "[interposer][twins]") {
    Scenario scenario{"exit_busy", 5};
    scenario.reports = !on_real_gpu();  // where the first launch takes longer than the program
    check_twin(scenario);
}

TEST_CASE("Calls work the same when they are made at exit", "[interposer][twins]") {
    check_twin({"calls_at_exit"});
}

TEST_CASE("Green contexts work the same when UrgenGo is loaded", "[interposer][twins][life]") {
    check_twin({"green_contexts"});
}

TEST_CASE("Context is destroyed as usual when a launch there is held",
          "[interposer][twins][life]") {
    check_twin({"destroyed_held"});
}

TEST_CASE("Device is reset as usual when other threads launch", "[interposer][twins][life]") {
    check_twin({"reset_busy"});
}

TEST_CASE("Calls work the same when their thread is ending", "[interposer][twins][life]") {
    check_twin({"thread_ends"});
}

TEST_CASE("Children run as usual when their parent is scheduled", "[interposer][twins][life]") {
    Scenario scenario{"children"};
    scenario.starts = 3;
    check_twin(scenario);
}

TEST_CASE("Program is replaced as usual when a thread executes another",
          "[interposer][twins][life]") {
    Scenario scenario{"exec_from_thread"};
    scenario.starts = 2;
    check_twin(scenario);
}

TEST_CASE("Program ends as usual when it leaves quickly", "[interposer][twins][life]") {
    Scenario scenario{"quick_exit", 7};
    scenario.reports = false;  // handlers of exit do not run
    check_twin(scenario);
}

TEST_CASE("Calls work the same when handlers of exit make them", "[interposer][twins][life]") {
    check_twin({"exit_order", 8});
}

TEST_CASE("Program is left alone when it never initialises the driver",
          "[interposer][twins][life]") {
    Scenario scenario{"no_init"};
    scenario.starts = 0;
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Program is left alone when it only looks for devices", "[interposer][twins][life]") {
    Scenario scenario{"only_queries"};
    scenario.starts = 0;
    scenario.reports = false;
    check_twin(scenario);
}

TEST_CASE("Launches block as usual when the environment asks for it", "[interposer][twins][life]") {
    Scenario scenario{"blocking_launches"};
    scenario.environment = {{"CUDA_LAUNCH_BLOCKING", "1"}};
    check_twin(scenario);
    // And the bare run did block: no query found its stream busy.
    const Outcome alone = run_twin({scenario.name}, with(scenario.environment, bare()));
    CHECK(alone.out.find("= 600") == std::string::npos);
    CHECK(run_twin({scenario.name}, bare()).out.find("= 600") != std::string::npos);
}

TEST_CASE("Driver opened by name works the same when it is closed again",
          "[interposer][twins][life]") {
    check_twin({"dlclose"}, TWIN_DLOPEN_PATH);
}

TEST_CASE("Hints change nothing that a program sees when they are given", "[interposer][twins]") {
    check_twin({"hints"});
}

TEST_CASE("Driver opened by name works the same when the program is linked to it",
          "[interposer][twins]") {
    check_twin({"dlopen"});
}

TEST_CASE("Driver opened by name works the same when nothing else names it",
          "[interposer][twins]") {
    // The thread's name is the program's: one that the configs' globs match too.
    check_twin({"dlopen"}, TWIN_DLOPEN_PATH);
}
