// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/chain_runner.h"

#include <pthread.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <span>

namespace urgengo::chains {

using std::chrono::nanoseconds;

namespace {

// How long a waiting thread may overlook that it should stop.
constexpr std::chrono::milliseconds kStopPoll{20};

// What a task allocates and frees, if it does.
constexpr std::size_t kScratchBytes = 1 << 20;

void sleep_until(Clock::time_point when) {
    const auto since_epoch = when.time_since_epoch();
    const auto seconds = std::chrono::duration_cast<std::chrono::seconds>(since_epoch);
    const timespec until{static_cast<time_t>(seconds.count()),
                         static_cast<long>(nanoseconds(since_epoch - seconds).count())};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
    }
}

/// @returns false if the run stopped first
bool wait_until(Clock::time_point when, const std::atomic<bool>& stop) {
    for (auto now = Clock::now(); now < when; now = Clock::now()) {
        if (stop) return false;
        sleep_until(std::min(when, now + kStopPoll));
    }
    return !stop;
}

std::size_t num_kernels(const Chain& chain, std::size_t first_task, std::size_t end_task) {
    std::size_t sum = 0;
    for (std::size_t i = first_task; i < end_task; i++) sum += chain.tasks[i].kernels.size();
    return sum;
}

void spend(nanoseconds time, bool spin) {
    const auto end = Clock::now() + time;
    if (!spin) return sleep_until(end);
    while (Clock::now() < end) {
    }
}

}  // namespace

ChainRunner::Stage::Stage(const RunContext& context, const Chain& chain, std::size_t first,
                          std::size_t end, std::size_t num_frames)
    : thread_name(chains::thread_name(context.options.threads, chain, chain.tasks[first])),
      first_task(first),
      end_task(end),
      stream(context.gpu, context.options.stamps ? num_frames * num_kernels(chain, first, end) : 0),
      input(context.options.keep_latest),
      launched(end - first) {
    // Not while frames run.
    for (auto& frames : launched) frames.reserve(num_frames);
    runs.reserve(num_frames * (end - first));
}

ChainRunner::ChainRunner(const RunContext& context, const Chain& chain,
                         std::vector<PlannedFrame> frames, nanoseconds deadline, bool frees)
    : context_(context),
      chain_(chain),
      frames_(std::move(frames)),
      deadline_(deadline),
      frees_(frees),
      records_(frames_.size()) {
    for (std::size_t i = 0; i < frames_.size(); i++) records_[i].arrival = frames_[i].arrival;
    const RunnerOptions& options = context.options;
    const std::size_t num_tasks = chain.tasks.size();
    const std::size_t tasks_per_stage = options.threads == Threads::kPerChain ? num_tasks : 1;
    for (std::size_t first = 0; first < num_tasks; first += tasks_per_stage) {
        stages_.push_back(std::make_unique<Stage>(context, chain, first, first + tasks_per_stage,
                                                  frames_.size()));
        if (first > 0) stages_[stages_.size() - 2]->next = stages_.back().get();
    }
}

ChainRunner::~ChainRunner() {
    join();
}

void ChainRunner::start(Clock::time_point start) {
    start_ = start;
    for (auto& stage : stages_) {
        stage->thread = std::thread([this, &stage = *stage] { run_stage(stage); });
    }
}

void ChainRunner::join() {
    for (auto& stage : stages_) {
        if (stage->thread.joinable()) stage->thread.join();
    }
}

void ChainRunner::rethrow_error() const {
    for (const auto& stage : stages_) {
        if (stage->error) std::rethrow_exception(stage->error);
    }
}

void ChainRunner::run_stage(Stage& stage) {
    pthread_setname_np(pthread_self(), stage.thread_name.c_str());
    prctl(PR_SET_TIMERSLACK, 1);
    try {
        context_.gpu.bind_thread();
        if (stage.first_task == 0) {
            take_arrivals(stage);
        } else {
            while (const auto frame = stage.input.pop()) process(stage, *frame);
        }
    } catch (const std::exception&) {
        stage.error = std::current_exception();
        context_.stop = true;
    }
    if (stage.next) stage.next->input.close();
}

void ChainRunner::take_arrivals(Stage& stage) {
    for (std::size_t i = 0; i < frames_.size(); i++) {
        const auto arrival = start_ + frames_[i].arrival;
        if (!wait_until(arrival, context_.stop)) return;
        const bool overtaken =
            i + 1 < frames_.size() && start_ + frames_[i + 1].arrival <= Clock::now();
        if (context_.options.keep_latest && overtaken) {
            finish({i, 0}, Outcome::kDropped);  // the middleware never hands it out
            continue;
        }
        const auto arrival_ns = nanoseconds(arrival.time_since_epoch()).count();
        const ug_instance instance =
            context_.hints.arrival(chain_.name.c_str(), arrival_ns, UG_CLOCK_MONOTONIC);
        process(stage, {i, instance});
    }
}

void ChainRunner::process(Stage& stage, const Frame& frame) {
    for (std::size_t task = stage.first_task; task < stage.end_task; task++) {
        const char* name = chain_.tasks[task].name.c_str();
        if (context_.hints.task_begin(frame.instance, name) == UG_EXIT_CHAIN) {
            return finish(frame, Outcome::kExited);
        }
        run_task(stage, task, frame);
        if (task + 1 == chain_.tasks.size()) {
            InstanceRecord& record = records_[frame.index];
            record.end = Clock::now() - start_;
            finish(frame, record.latency() <= deadline_ ? Outcome::kOnTime : Outcome::kLate);
        }
        context_.hints.task_end();
    }
    if (!stage.next) return;
    if (const auto overtaken = stage.next->input.push(frame)) finish(*overtaken, Outcome::kDropped);
}

void ChainRunner::run_task(Stage& stage, std::size_t task, const Frame& frame) {
    const PlannedFrame& planned = frames_[frame.index];
    const std::span<const Kernel> kernels = chain_.tasks[task].kernels;
    spend(planned.cpu[task], context_.options.cpu_spin);
    DeviceBuffer scratch;
    if (frees_ && task == 0) scratch = DeviceBuffer(kScratchBytes);
    stage.runs.begin({static_cast<std::uint32_t>(task), static_cast<std::uint32_t>(frame.index),
                      stage.stream.launches(), static_cast<std::uint32_t>(kernels.size())});
    const auto begin = Clock::now();
    stage.stream.launch(kernels.first(1), planned.size[task]);
    if (task == 0) {
        InstanceRecord& record = records_[frame.index];
        record.begin = begin - start_;
        record.first_launched = Clock::now() - start_;
        record.thread = gettid();
    }
    stage.stream.launch(kernels.subspan(1), planned.size[task]);
    stage.launched[task - stage.first_task].push_back(frame.index);
    scratch = DeviceBuffer();
    stage.stream.synchronize();
    stage.runs.end();
}

void ChainRunner::finish(const Frame& frame, Outcome outcome) {
    records_[frame.index].outcome = outcome;
}

Verification ChainRunner::verify(const BlockValues& values) const {
    Verification verification;
    for (const auto& stage : stages_) {
        const StreamResults results = stage->stream.read_results();
        verification.sum += results.sum;
        verification.missing_blocks += stage->stream.blocks_launched() - results.blocks_done;
        verification.misordered_blocks += results.blocks_misordered;
        for (std::size_t i = 0; i < stage->launched.size(); i++) {
            const std::size_t task = stage->first_task + i;
            for (const std::size_t frame : stage->launched[i]) {
                verification.expected_sum +=
                    values.task_sum(chain_.tasks[task], frames_[frame].size[task]);
            }
        }
    }
    return verification;
}

PositionSampler::Target ChainRunner::sampled_stage(std::size_t stage) const {
    PositionSampler::Target target{chain_.name, {}, &stages_[stage]->runs};
    for (const Task& task : chain_.tasks) target.tasks.push_back(task.name);
    return target;
}

StampedStream ChainRunner::stamped_stage(std::size_t stage) const {
    StampedStream stream;
    stream.chain = chain_.name;
    for (const Task& task : chain_.tasks) stream.tasks.push_back(task.name);
    stream.launches = stages_[stage]->stream.launches();
    stream.stamps = stages_[stage]->stream.read_stamps();
    stream.runs = stages_[stage]->runs.all();
    return stream;
}

}  // namespace urgengo::chains
