// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/sim_options.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "host/config/limits.h"
#include "host/config/presets.h"

namespace urgengo::cli {

CLI::App* add_sim(CLI::App& app, SimOptions& options) {
    CLI::App* command = app.add_subcommand(
        "sim",
        "What `bench smoke` measures, in virtual time: models of GPU, CPU and programs, no GPU "
        "needed, the same result on any machine");
    command
        ->add_option("--rows", options.rows,
                     fmt::format("What to compare [bare,urgengo]: bare, the program alone; presets "
                                 "({}), with changes as `bench smoke` takes them "
                                 "(urgengo+guard=off, urgengo+dispatch=armed); all",
                                 config::preset_names()))
        ->delimiter(',');
    command->add_option("--f-a", options.f_a, "Factors on arrival rates [0.7,0.9,1.1]")
        ->delimiter(',')
        ->check(CLI::Range(0.01, 100.0));
    command->add_option("--f-d", options.f_d, "Factor on deadlines [1]")
        ->check(CLI::Range(0.01, 100.0));
    command
        ->add_option("--f-tight", options.f_tight, "Part of the ten chains with half the deadline")
        ->check(CLI::Range(0.0, 1.0))
        ->capture_default_str();
    command->add_option("--warmup", options.warmup, "Seconds of each run whose frames do not count")
        ->check(CLI::Range(0.0, 100'000.0))
        ->capture_default_str();
    command->add_option("--seconds", options.seconds, "For how long frames arrive in each run [10]")
        ->check(CLI::Range(0.1, 100'000.0));
    command
        ->add_option("--seeds", options.seeds,
                     "Seeds of the arrivals: those of `bench smoke` with the same [1,2,3]")
        ->delimiter(',');
    command->add_option("--cores", options.cores, "Cores of the simulated host")
        ->check(CLI::Range(1, 1024))
        ->capture_default_str();
    command
        ->add_option("--connections", options.connections,
                     "Queues to the GPU that streams share; 0: as many as the row needs")
        ->check(CLI::Range(std::int64_t{0}, config::kConnections.max))
        ->capture_default_str();
    command
        ->add_option("--workload", options.workload,
                     "From `urgengo-chains calibrate`, or the chains.yaml of a program that has a "
                     "profile; without: the ten chains as calibrated on an H200")
        ->check(CLI::ExistingFile);
    command
        ->add_option("--profile", options.profile,
                     "Of a program whose chains.yaml is the workload [<its stem>.profile.json]")
        ->check(CLI::ExistingFile);
    command
        ->add_option("--mark-late-us", options.mark_late_us,
                     "From a progress mark's end on the GPU to when the host sees it")
        ->check(CLI::Range(0.0, 10'000.0))
        ->capture_default_str();
    command
        ->add_option("--bystander-ms", options.bystander_ms,
                     "A thread of no chain fills the GPU for so long; 0: there is none")
        ->check(CLI::Range(0.0, 10'000.0))
        ->capture_default_str();
    command->add_option("--bystander-every-ms", options.bystander_every_ms, "And does it so often")
        ->check(CLI::Range(0.1, 10'000.0))
        ->capture_default_str();
    command->add_flag("--bystander-matmul", options.bystander_matmul,
                      "Instead a thread of no chain multiplies matrices back to back, as beside "
                      "mixes of real networks");
    command
        ->add_option(
            "--parking-every-ms", options.parking_every_ms,
            "A thread of no chain makes a call that waits for all GPU work (a free, say) so "
            "often: no gate is closed meanwhile; 0: there is none")
        ->check(CLI::Range(0.0, 10'000.0))
        ->capture_default_str();
    command
        ->add_option("--launch-capacity", options.launch_capacity,
                     "Threads that launch slow each other down: k of them get k * C / (k + C - 1) "
                     "done together; seven traced networks: 2.7; 0: they do not")
        ->check(CLI::Range(0.0, 1000.0))
        ->capture_default_str();
    command
        ->add_option("--stall-ms", options.stall_ms,
                     "Now and then all threads stand still for so long, as on a loud machine; the "
                     "GPU goes on; 0: they never do")
        ->check(CLI::Range(0.0, 10'000.0))
        ->capture_default_str();
    command->add_option("--stall-every-ms", options.stall_every_ms, "And so often, in the mean")
        ->check(CLI::Range(1.0, 100'000.0))
        ->capture_default_str();
    command
        ->add_option("--compare", options.compare,
                     "Results of `bench smoke`, or of mixes of real networks that --workload is "
                     "one of: the same rows, loads, seeds and length unless given, and by how much "
                     "their misses differ")
        ->check(CLI::ExistingFile);
    command->add_flag("--least", options.least,
                      "Also how few misses there can be: a bound that no scheduler is below");
    command->add_option("--json,--out", options.out, "Write the results as JSON");
    command->add_flag("-q,--quiet", options.quiet, "No progress bar");
    return command;
}

}  // namespace urgengo::cli
