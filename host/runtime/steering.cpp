// SPDX-License-Identifier: Apache-2.0
#include "host/runtime/steering.h"

#include <algorithm>
#include <array>
#include <optional>

#include "host/base/log.h"
#include "host/base/memory_orders.h"
#include "host/base/own_log.h"
#include "host/config/names.h"

namespace urgengo::runtime {
namespace {

using abi::ControlCommand;
using abi::ControlResult;

constexpr nanoseconds kLook{500'000};
constexpr std::uint32_t kNumbers = 1u << 24;

std::optional<config::Mode> mode_for_all(ControlCommand command, config::Mode first) {
    switch (command) {
        case ControlCommand::kOff:
            return config::Mode::kOff;
        case ControlCommand::kObserve:
            return config::Mode::kObserve;
        case ControlCommand::kOn:
            return first;
        case ControlCommand::kShadow:
            return config::Mode::kShadow;
        default:
            return std::nullopt;
    }
}

std::optional<config::Mode> mode_for_chain(ControlCommand command) {
    switch (command) {
        case ControlCommand::kChainOff:
            return config::Mode::kOff;
        case ControlCommand::kChainObserve:
            return config::Mode::kObserve;
        case ControlCommand::kChainShadow:
            return config::Mode::kShadow;
        case ControlCommand::kChainOn:
            return config::Mode::kEnforce;
        default:
            return std::nullopt;
    }
}

}  // namespace

Steering::Steering(Common& common, Runs& runs, identity::Instances& instances, Reloading& reloading)
    : common_(common),
      runs_(runs),
      instances_(instances),
      reloading_(reloading),
      first_(common.mode()) {}

void Steering::set_mode(config::Mode mode) {
    common_.governor.steered().set(mode);
    common_.nice.give_back();  // a thread that is scheduled takes it anew
    common_.status.set_mode(mode);
    changed();
    common_.observers.records.mode(observe::to_status(mode), common_.clock.now());
}

void Steering::changed() {
    common_.guard.pause();
    common_.governor.tasks().changed();
}

// Of words that came fast after each other only the last was seen: the others are read where they
// left what they say. One that has been overwritten there meanwhile is lost.
void Steering::obey(std::uint32_t word) {
    std::array<Request, abi::kControlRing> requests;
    std::size_t count = 0;
    const std::uint32_t skipped = (abi::number_of(word) - abi::number_of(seen_) - 1) % kNumbers;
    for (std::uint32_t back = std::min(skipped, abi::kControlRing - 1); back > 0; --back) {
        const auto request = common_.status.control_request(word - (back << 8));
        if (request) requests[count++] = *request;
    }
    constexpr std::uint32_t kNoChain = ~0u;
    auto last = common_.status.control_request(word);
    if (!last || last->word != word) last = Request{word, kNoChain};
    requests[count++] = *last;
    obey({requests.data(), count});
}

void Steering::obey(std::span<const Request> requests) {
    abi::StatusHeader& header = common_.status.header();
    for (const Request& request : requests) {
        const ControlResult result = obey_one(request);
        if (result != ControlResult::kDone) {
            header.control_refused.fetch_add(1, kRelaxed);
            note(LogDetail::kInfo, "a control word is refused: {:08x}", request.word);
        }
        common_.status.answer(request.word, result);
    }
    const std::uint32_t left = holds_left();
    if (left > 0) note(LogDetail::kInfo, "{} held threads have had no core since", left);
    common_.streams.priorities().give_back_refused();
    common_.nice.give_back();
    seen_ = requests.back().word;
    header.holds_left.store(left, kRelaxed);
    header.control_seen_ns.store(common_.clock.now().count(), kRelaxed);
    header.control_seen.store(seen_, std::memory_order_release);
}

ControlResult Steering::obey_one(const Request& request) {
    const ControlCommand command = abi::command_of(request.word);
    const auto for_all = mode_for_all(command, first_);
    const auto for_chain = mode_for_chain(command);
    if (!for_all && !for_chain && command != ControlCommand::kReload)
        return ControlResult::kMeansNothing;
    if (for_good_.load() != config::Mode::kEnforce) {
        if (command != ControlCommand::kOff) return ControlResult::kOffForGood;
        never_again(config::Mode::kOff);
        common_.status.tripped();
        leave_instances();
        return ControlResult::kDone;
    }
    if (command == ControlCommand::kReload) return reload(request.word);
    if (for_all) {
        steer_all(*for_all);
        note(LogDetail::kInfo, "mode {}, as asked by urgengo ctl", config::to_word(*for_all));
    } else {
        if (request.chain >= common_.roster.chains().size()) return ControlResult::kNoChain;
        steer(request.chain, *for_chain);
        note(LogDetail::kInfo, "mode {} of chain {}, as asked by urgengo ctl",
             config::to_word(*for_chain), common_.roster.chains()[request.chain]->config.name);
    }
    return ControlResult::kDone;
}

ControlResult Steering::reload(std::uint32_t word) {
    const auto path = common_.status.control_path();
    const auto done =
        path ? reloading_.reload(*path) : Result<Reloading::Done>(Error{"no config is named"});
    common_.status.tell(word, done ? done->text : done.error());
    if (!done) return ControlResult::kRefused;
    common_.observers.records.reloaded(common_.clock.now());
    log_line("reloaded " + *path + ": " + done->text);
    if (done->changes_mode) {
        // What the kill switch was last told is not undone.
        const bool is_as_started = common_.mode() == first_;
        first_ = done->mode;
        if (is_as_started) steer_all(first_);
    }
    return ControlResult::kDone;
}

void Steering::steer_all(config::Mode mode) {
    // What a thread began while it was being switched off is not gone on with.
    if (common_.mode() == config::Mode::kOff) leave_instances();
    set_mode(mode);
    // UrgenGo may have switched itself off meanwhile.
    if (const config::Mode last = for_good_.load(); last != config::Mode::kEnforce) {
        set_mode(last);
        common_.status.tripped();
    }
    if (!common_.governor.acts()) common_.gate_keeper.holds_end();
    if (common_.mode() == config::Mode::kOff) leave_instances();
    // Last: another tool may wait for whatever holds held up.
    common_.observers.nvtx.mode(common_.status.header().mode.load(kRelaxed));
}

void Steering::steer(std::size_t index, config::Mode mode) {
    ChainState& chain = *common_.roster.chains()[index];
    if (chain.is_switched_off()) leave_instances(chain);
    chain.allowed.store(mode, kRelaxed);
    common_.status.allow(index, mode);
    common_.observers.records.chain_mode(chain, observe::to_status(mode), common_.clock.now());
    changed();
    if (!chain.may_act()) common_.gate_keeper.holds_of_chains_end();
    if (chain.is_switched_off()) leave_instances(chain);
}

void Steering::leave_instances() {
    runs_.end_all();
    instances_.forget_passages();
}

void Steering::leave_instances(const ChainState& chain) {
    runs_.end_all(chain);
    instances_.forget_passages(chain.index);
}

// A thread in a hold looks again by itself: this only tells when. A launch that is held for
// something else than us (it is in the driver) is in no hold.
std::uint32_t Steering::holds_left() const {
    const auto num_held = [&] {
        return static_cast<std::uint32_t>(std::count_if(
            common_.roster.tasks().begin(), common_.roster.tasks().end(), [&](const auto& task) {
                return !common_.may_hold(*task) &&
                       task->taking.held_frame.load(kRelaxed) != nullptr;
            }));
    };
    std::uint32_t held = num_held();
    for (auto looks = kHoldsEnd / kLook; held > 0 && looks > 0; --looks) {
        common_.clock.sleep_for(kLook);
        held = num_held();
    }
    return held;
}

}  // namespace urgengo::runtime
