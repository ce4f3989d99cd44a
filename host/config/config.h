// SPDX-License-Identifier: Apache-2.0
//
// What a user says in chains.yaml, and what a profile knows about the program: plain data.
//
// The CLI reads and validates the YAML (config_reader), merges the profile, and writes both as one
// JSON file (resolved_config) that the interposer reads. Nothing here does anything.
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace urgengo::config {

using std::chrono::nanoseconds;

enum class Mode { kOff, kObserve, kShadow, kEnforce };
/// What becomes of an instance that cannot meet its deadline any more. kContinue: it goes behind
/// all that can. kDemote: it runs only where no other task wants the GPU. kExit: the program, asked
/// before its next task (ug_task_begin), is told to end it; until then as kContinue.
enum class OnLate { kContinue, kDemote, kExit };
enum class ArrivalFrom { kFirstCall, kHint };
/// The order of tasks: host/sched/policies/, one file each.
enum class Policy {
    kFeasible,
    kUrgency,
    kEdf,
    kEqdf,
    kSaedf,
    kLcuf,
    kSjf,
    kHrrn,
    kStatic,
    kFifo,
    kUtilization
};
/// What a launch's priority follows: host/sched/binding.h.
enum class Binding { kNone, kTask, kKernel, kStatic };
/// Whether a launch may go: host/sched/admission.h.
enum class Admission { kNone, kThreshold, kPacked, kExclusive, kBuckets, kGroups };
/// How a launch gets its priority. kAuto: as the priority probe found for this GPU and driver; who
/// reads it without such an answer takes it for kLaunchAttribute.
enum class PriorityVia { kAuto, kLaunchAttribute, kStreamAttribute, kStreamPool };

/// What tells how far the GPU is (host/exec/progress_marks.h). kAuto: see progress_choice.h.
enum class ProgressSource { kAuto, kKernel, kMemop, kEvent };

/// How the executing kernel is known. kProgress: by marks behind the work. The others are the
/// paper's ways, for comparison (docs/configuration.md, tracking).
enum class Tracking { kProgress, kAsync, kSync, kBatched, kOverlapped };

/// Who lets launches go that have to wait. kThread: their own thread, which sleeps meanwhile. Else
/// they are made at once, behind a gate, which kHost: a thread of ours, or kDevice: the GPU, opens.
/// kAuto: kDevice while the host's cores are busy, else kThread.
enum class Dispatch { kThread, kHost, kDevice, kAuto };
/// How the GPU does. kPiggyback: progress marks do; kLeased: a resident kernel, for at most a lease
/// at a time; kArmed: kernels that wait in a stream of ours until a mark wakes them.
enum class DeviceDispatch { kPiggyback, kLeased, kArmed };

/// Whether another NVTX tool is told what we do. kAuto, kOn: if there is one; kOn says so if not.
enum class NvtxEvents { kAuto, kOn, kOff };

/// What starts a task: a kernel, by name and perhaps by size. In YAML "conv*" or "conv*@392x256".
struct KernelPattern {
    std::string name_glob{};          ///< fnmatch pattern on the kernel's (mangled) name
    std::uint64_t grid_blocks = 0;    ///< 0: any
    std::uint32_t block_threads = 0;  ///< 0: any

    friend bool operator==(const KernelPattern&, const KernelPattern&) = default;
};

/// How a launch is known to be of this task, besides hints. Empty: not by that.
struct Task {
    std::string name;
    std::string thread_glob{};  ///< fnmatch pattern on the thread's name
    std::string nvtx_glob{};    ///< fnmatch pattern on the innermost NVTX ranges of the thread
    std::vector<KernelPattern> kernels{};  ///< any of which is the first of the task
};

struct Chain {
    std::string name;
    nanoseconds period{0};    ///< > 0
    nanoseconds deadline{0};  ///< > 0, end to end, from the frame's arrival
    OnLate on_late = OnLate::kContinue;
    std::vector<Task> tasks;  ///< in the order in which a frame passes through them; not empty
    ArrivalFrom arrival = ArrivalFrom::kFirstCall;  ///< kHint: without a hint nothing is scheduled
    Mode mode = Mode::kEnforce;                     ///< the weaker one of this and the config's
    int criticality = 1;             ///< larger matters more where not all chains can be met
    int max_consecutive_misses = 0;  ///< after so many the chain goes before others; 0: never
};

/// Which work may run side by side; for admission `packed`.
struct Packing {
    double limit = 1.05;  ///< summed utilisation that may run side by side
    /// The same while all, or all that go before, are in time by share_slack.
    double share_limit = 1.6;
    nanoseconds share_slack{10'000'000};
    int launchers = 2;  ///< so many that slow each other's launching launch; 0: all
};

/// How long launches are held.
struct HoldLimits {
    nanoseconds poll{50'000};  ///< a held thread looks again after this long
    /// Holds may add this much to one instance; 0: so many of its deadlines.
    nanoseconds max_per_instance{0};
    double max_deadlines = 2;
};

/// Estimated GPU time launched and not yet executed, at most.
struct RunAhead {
    nanoseconds limit{1'000'000};
    /// The same where no other chain has come to the GPU for a second, and two of each chain's
    /// periods, if it is more; for binding `kernel` with three priority levels or more.
    nanoseconds alone{4'000'000};
};

/// How the GPU's progress is known.
struct ProgressSettings {
    /// Estimated GPU time between two marks; 0: every launch; none: as suits the source
    /// (progress_choice.h).
    std::optional<nanoseconds> mark_every;
    ProgressSource source = ProgressSource::kAuto;
    Tracking tracking = Tracking::kProgress;
    nanoseconds eval_interval{500'000};  ///< kBatched, kOverlapped: estimated GPU time of a batch
    bool learn = false;  ///< `progress: {learn: on}`: kernels' times follow what marks measure
};

struct PrioritySettings {
    PriorityVia via = PriorityVia::kAuto;
    int levels = 0;  ///< of the device's, so many are used; 0: all
};

/// What single policies and admissions read.
struct PolicyParameters {
    double lambda = 1;                ///< kEqdf, kSaedf: weight of CPU or GPU time
    double plan_margin = 0;           ///< kFeasible: GPU times are taken to be so much longer
    double exempt_utilization = 0.1;  ///< kThreshold: smaller launches are not held
    double urgent_percentile = 95;    ///< kThreshold, kTask: of the recorded highest urgencies
    nanoseconds quantum{1'000'000};   ///< kGroups: a group's turn
};

struct CopySettings {
    bool hold = false;             ///< `copies: {hold: on}`
    std::int64_t slice_bytes = 0;  ///< larger asynchronous copies are cut; 0: none is
};

/// Whether launches are held by their thread or behind gates, and who opens these.
struct DispatchSettings {
    Dispatch where = Dispatch::kThread;              ///< `dispatch: {where: ...}`
    DeviceDispatch device = DeviceDispatch::kArmed;  ///< `dispatch: {device: ...}`
    /// kLeased: resident for so long at most. kArmed: what waits in vain does for so long.
    nanoseconds lease{2'000'000};
    nanoseconds idle{200'000};        ///< kLeased: it leaves after so long without a closed gate
    nanoseconds gate_group{200'000};  ///< GPU time of the launches behind a gate, if they are short
    int most_gates = 12;              ///< closed ones of a task
};

/// The keys under `scheduler:`. A preset fills all of them; the keys that the user wrote override.
struct Scheduler {
    std::string preset = "urgengo";
    Policy policy = Policy::kFeasible;
    Binding binding = Binding::kKernel;
    Admission admission = Admission::kPacked;
    Packing packing;
    HoldLimits hold;
    RunAhead run_ahead;
    ProgressSettings progress;
    PrioritySettings priority;
    PolicyParameters parameters;
    CopySettings copies;
    DispatchSettings dispatch;
    bool guard = true;  ///< chains that scheduling makes later are left alone (sched/guard.h)
};

/// Config::connections by the number of tasks.
inline constexpr int kAutoConnections = -1;

struct Config {
    int version = 1;
    Mode mode = Mode::kEnforce;
    std::vector<Chain> chains;
    Scheduler scheduler;
    /// CUDA_DEVICE_MAX_CONNECTIONS for the program; 0: keep (connections.h)
    int connections = kAutoConnections;
    bool blocking_sync = false;  ///< `cpu: {blocking_sync: on}`: waits sleep instead of spinning
    std::optional<int> nice;     ///< `cpu: {nice: -15}`: of threads that work on frames of chains
    NvtxEvents nvtx = NvtxEvents::kAuto;
};

/// A kernel as it is launched: one launch of a task, or (TaskProfile::sizes) the mean of many.
struct KernelProfile {
    std::string name;
    std::uint64_t grid_blocks = 0;    ///< x*y*z
    std::uint32_t block_threads = 0;  ///< x*y*z
    /// E_k, alone on the GPU: what the union of the segment's kernels grows by with this one. On
    /// one stream that is the kernel's own time; the E_k of an instance add up to its busy time.
    nanoseconds gpu_time{0};
    double utilization = 0;     ///< share of the GPU that it occupies, 0..1 (U_k in the paper)
    std::uint32_t samples = 0;  ///< launches that the time was learned from
    nanoseconds launch_time{
        0};                    ///< alone: from the segment's first launch to this one; 0: not known
    std::uint32_t stream = 0;  ///< branch: 0 is the stream of the segment's first launch
};

/// Launches up to a synchronisation that waits for them, and the CPU segment before.
struct SegmentProfile {
    nanoseconds cpu_time{0};         ///< of the CPU segment before its first launch
    std::uint32_t num_launches = 0;  ///< the typical instance's: so many of TaskProfile::kernels
    std::uint32_t min_launches = 0;  ///< seen in any instance
    std::uint32_t max_launches = 0;
    std::string closed_by;   ///< what waited: stream, context, event, copy, ...
    nanoseconds latency{0};  ///< alone: from its first launch to the end of the wait; 0: not known
};

struct TaskProfile {
    std::string name;
    nanoseconds cpu_time{0};               ///< of all CPU segments up to the last launch
    std::vector<KernelProfile> kernels{};  ///< of the typical instance, in launch order (N of them)
    std::vector<SegmentProfile> segments{};  ///< in order (M of them); empty: not known
    std::vector<KernelProfile> sizes{};      ///< look-up by name, grid and block
    std::uint32_t instances = 0;             ///< that this was learned from
    std::uint32_t start_up_launches = 0;     ///< before the first of them, left out (a run's most)
};

struct ChainProfile {
    std::string name;
    std::vector<TaskProfile> tasks;
};

/// KernelProfile::name of a graph launch, whose grid and block are 1.
inline constexpr char kGraphName[] = "(graph)";

inline constexpr int kProfileFormatVersion = 2;

struct Profile {
    int format_version = kProfileFormatVersion;
    std::string gpu;
    std::string driver;              ///< as the driver numbers CUDA: "13.0"
    std::uint32_t sm_clock_mhz = 0;  ///< peak; 0: not known
    std::uint32_t memory_clock_mhz = 0;
    std::string program;                ///< file name of what was run, without its folder
    std::uint64_t kernel_set_hash = 0;  ///< of the sorted names of all kernels in it
    std::uint32_t runs = 1;             ///< merged into this
    std::vector<ChainProfile> chains;
};

}  // namespace urgengo::config
