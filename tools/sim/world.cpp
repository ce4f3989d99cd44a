// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/world.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace urgengo::sim {
namespace {

nanoseconds from_ms(double ms) {
    return std::isfinite(ms) ? nanoseconds(static_cast<std::int64_t>(ms * 1e6)) : kNever;
}

nanoseconds from_s(double seconds) {
    return from_ms(seconds * 1000);
}

/// Apart from what arrivals are drawn with.
constexpr std::uint32_t kCpuSeed = 7919;
constexpr std::uint32_t kStallSeed = 104729;
/// From an event's end on the GPU until a thread that asks without pause knows: until the host can
/// see it, and the question that is told so. @source measured on an H200
constexpr nanoseconds kEventSeen{3'200};
/// Tells of progress so often.
constexpr nanoseconds kTellEvery{100'000'000};

WorldSettings with_connections(WorldSettings settings, const Subject& subject) {
    settings.gpu.num_connections =
        settings.connections > 0 ? settings.connections : subject.num_connections();
    return settings;
}

}  // namespace

World::World(const chains::Workload& workload, Subject& subject, const WorldSettings& settings)
    : workload_(workload),
      subject_(subject),
      settings_(with_connections(settings, subject)),
      gpu_(settings_.gpu),
      cpu_(settings.cpu, kCpuSeed * settings.seed),
      stalls_(settings.stalls, from_s(settings.seconds), kStallSeed * settings.seed),
      waits_(workload.chains.size() + 1),
      waits_for_mark_(workload.chains.size() + 1) {
    subject.connect(*this);
    subject.connect_gates(*this);
    for (const chains::Chain& chain : workload.chains) add_chain(chain);
    if (settings.bystander.length.count() > 0)
        bystander_ = std::make_unique<BystanderModel>(settings.bystander, gpu_.add_stream(),
                                                      from_s(settings.seconds), *this, subject);
    add_branches();
    if (settings.parking_every.count() > 0)
        parking_ = std::make_unique<ParkingCalls>(settings.parking_every, from_s(settings.seconds),
                                                  gpu_, subject);
}

// Behind all threads' first ones, as libraries make theirs later.
void World::add_branches() {
    const auto num_threads = static_cast<int>(chains_.size() + (bystander_ ? 1 : 0));
    for (int thread = 0; thread < num_threads; ++thread) threads_.push_back(thread);
    for (std::size_t i = 0; i < chains_.size(); ++i) {
        branches_.emplace_back();
        const int thread = static_cast<int>(i);
        for (int branch = 1; branch < traits(thread).num_branches(); ++branch) {
            branches_.back().push_back(gpu_.add_stream());
            threads_.push_back(thread);
        }
    }
}

const ChainTraits& World::traits(int thread) const {
    static const ChainTraits kPlain;
    const auto place = static_cast<std::size_t>(thread);
    return place < settings_.traits.size() ? settings_.traits[place] : kPlain;
}

int World::stream(int thread, int branch) const {
    if (branch == 0) return thread;
    return branches_[static_cast<std::size_t>(thread)][static_cast<std::size_t>(branch - 1)];
}

void World::add_chain(const chains::Chain& chain) {
    const int thread = gpu_.add_stream();
    const auto place = static_cast<std::size_t>(thread);
    const chains::ArrivalSettings arrivals{settings_.seed,
                                           from_ms(settings_.scenario.period_ms(chain)),
                                           from_s(settings_.seconds), workload_.variable};
    chains_.push_back(std::make_unique<ChainModel>(
        chain, thread,
        settings_.frames.empty() ? chains::plan_frames(chain, chain.place, arrivals)
                                 : settings_.frames[place],
        from_ms(settings_.scenario.deadline_ms(chain)), traits(thread), *this, subject_));
}

void World::wake_at(int thread, nanoseconds when, bool is_late) {
    sleepers_.push(when + (is_late ? cpu_.wake_up_delay() : nanoseconds{0}), 0, thread);
}

void World::launch(int thread, int branch, const KernelWork& work) {
    gpu_.launch(stream(thread, branch), work);
}

void World::join(int thread, int branch, int other) {
    gpu_.join(stream(thread, branch), stream(thread, other));
}

bool World::wait(int thread) {
    if (gpu_.ended(thread) == gpu_.launched(thread)) return true;
    waits_[static_cast<std::size_t>(thread)] = true;
    cpu_.begin_spin();
    return false;
}

void World::wait_for_mark(int thread, std::int64_t tag) {
    waits_for_mark_[static_cast<std::size_t>(thread)] = tag;
    cpu_.begin_spin();
}

void World::mark(int chain, int branch, nanoseconds time, std::int64_t tag) {
    gpu_.launch(stream(chain, branch), {.tag = tag, .is_mark = true, .mark = time});
}

void World::gate(int chain, int branch, int word, std::uint32_t number, nanoseconds time) {
    gpu_.launch(stream(chain, branch), {.mark = time, .word = word, .number = number});
}

void World::open(int word, std::uint32_t number, nanoseconds late) {
    gpu_.open(word, number, late);
}

void World::wake_subject(nanoseconds when, int what, bool is_late) {
    calls_.push(when + (is_late ? cpu_.wake_up_delay() : nanoseconds{0}), what, 0);
}

bool World::take(int thread, int lock) {
    Lock& its = locks_[lock];
    if (its.is_taken) its.waiting.push_back(thread);
    return !std::exchange(its.is_taken, true);
}

void World::release(int lock) {
    Lock& its = locks_[lock];
    its.is_taken = !its.waiting.empty();
    if (!its.is_taken) return;
    wake_at(its.waiting.front(), now_, true);
    its.waiting.pop_front();
}

void World::mark_ended(const EndedKernel& mark) {
    const int thread = thread_of(mark.stream);
    subject_.mark_ended(thread, mark.tag, now_);
    std::int64_t& awaited = waits_for_mark_[static_cast<std::size_t>(thread)];
    if (awaited != mark.tag) return;
    awaited = 0;
    seeing_.push_back(thread);
}

bool World::has_waited_for(const EndedKernel& ended) {
    const auto thread = static_cast<std::size_t>(ended.stream);
    if (thread_of(ended.stream) != ended.stream) return false;  // it waits for its first
    if (!waits_[thread] || gpu_.ended(ended.stream) < gpu_.launched(ended.stream)) return false;
    waits_[thread] = false;
    return true;
}

nanoseconds World::next() const {
    if (stalls_.is_stalled()) return std::min(gpu_.next(), stalls_.next());
    return std::min({sleepers_.next(), calls_.next(), cpu_.next(), gpu_.next(), stalls_.next(),
                     parking_ ? parking_->next() : kNever});
}

// Those that can do something now.
void World::run_threads() {
    if (parking_) parking_->advance(now_);
    std::vector<int> ready = std::exchange(waited_, {});
    const std::vector<int> seeing = std::exchange(seeing_, {});
    const std::size_t num_waited = ready.size() + seeing.size();
    const auto& done = cpu_.advance(now_);
    ready.insert(ready.end(), done.begin(), done.end());
    for (std::size_t i = 0; i < num_waited; ++i) cpu_.end_spin();
    for (const int thread : seeing) cpu_.compute(thread, kEventSeen);
    while (calls_.next() <= now_) subject_.woken(calls_.pop().kind, now_);
    while (sleepers_.next() <= now_) ready.push_back(sleepers_.pop().subject);
    for (const int thread : ready) go_on(thread);
}

chains::RunReport World::run() {
    for (const auto& chain : chains_) chain->go_on(now_);
    if (bystander_) bystander_->go_on(now_);
    nanoseconds tell_at{0};
    bool is_interrupted = false;
    for (nanoseconds time = next(); time != kNever; time = next()) {
        now_ = time;
        if (now_ >= tell_at) {
            const double part = double(now_.count()) * 1e-9 / settings_.seconds;
            is_interrupted = !settings_.progress(std::min(1.0, part));
            if (is_interrupted) break;
            tell_at = now_ + kTellEvery;
        }
        for (const EndedKernel& kernel : gpu_.advance(now_)) {
            if (kernel.tag != 0) mark_ended(kernel);
            if (has_waited_for(kernel)) waited_.push_back(kernel.stream);
        }
        if (stalls_.advance(now_)) cpu_.stall(stalls_.is_stalled(), now_);
        if (!stalls_.is_stalled()) run_threads();
    }

    chains::RunReport report = this->report();
    report.interrupted = is_interrupted;
    return report;
}

void World::go_on(int thread) {
    const auto place = static_cast<std::size_t>(thread);
    if (place < chains_.size())
        chains_[place]->go_on(now_);
    else
        bystander_->go_on(now_);
}

chains::RunReport World::report() const {
    chains::RunReport report;
    report.gpu = workload_.gpu;
    report.num_sms = settings_.gpu.num_sms;
    report.cpu_segments = "spin";
    report.results = "not checked";
    report.arrivals_for = from_s(settings_.seconds);
    report.wall_s = double(now_.count()) * 1e-9;
    report.cpu_cores = cpu_.core_seconds() / report.wall_s;
    for (std::size_t i = 0; i < chains_.size(); ++i) {
        const chains::Chain& chain = workload_.chains[i];
        chains::ChainReport its;
        its.name = chain.name;
        its.period_ms = settings_.scenario.period_ms(chain);
        its.deadline_ms = settings_.scenario.deadline_ms(chain);
        its.tight = settings_.scenario.is_tight(chain);
        std::vector<chains::InstanceRecord> records = chains_[i]->records();
        std::erase_if(records, [&](const auto& r) { return r.arrival < from_s(settings_.warmup); });
        chains::summarize(its, std::move(records));
        report.chains.push_back(std::move(its));
    }
    return report;
}

}  // namespace urgengo::sim
