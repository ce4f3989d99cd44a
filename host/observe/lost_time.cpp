// SPDX-License-Identifier: Apache-2.0
#include "host/observe/lost_time.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "host/observe/pieces_beside.h"

namespace urgengo::observe {
namespace {

/// A piece is beside others from this share of it on.
constexpr double kBeside = 0.1;
/// Of the frame's work, in pieces beside no other: from there on they tell of all of it.
constexpr double kEnough = 0.05;
/// @source causes_check.py on an H100, one run beside kernels of no chain: of 2.09 s of these 1.78
///         are told, and 0.22 more in which there were none
constexpr double kFull = 0.9;
constexpr nanoseconds kBin{2'000'000};
constexpr std::int64_t kMostBins = 4096;

Span executing(const ExecutedPiece& piece) {
    return {piece.executes_from(), piece.executes_until()};
}

double in_ns(nanoseconds time) {
    return static_cast<double>(time.count());
}
nanoseconds to_ns(double time) {
    return nanoseconds(static_cast<std::int64_t>(time));
}

/// Calls act(piece) for each that has a part in the span. @param pieces  in order
template <typename Act>
void for_each_in(const std::vector<ExecutedPiece>& pieces, const Span& span, Act&& act) {
    auto piece = std::partition_point(pieces.begin(), pieces.end(), [&](const ExecutedPiece& each) {
        return each.end <= span.begin;
    });
    for (; piece != pieces.end() && piece->begin < span.end; ++piece) act(*piece);
}

/// When bystanders were on the GPU.
class Bystanders {
  public:
    Bystanders(const FramesWork& own, const std::vector<OthersSegment>& others) {
        if (!own.beside_bystanders) return;
        const auto cover = [&](nanoseconds begin, nanoseconds end) {
            all_ = {std::min(all_.begin, begin), std::max(all_.end, end)};
        };
        for (const ExecutedPiece& piece : own.pieces) cover(piece.begin, piece.end);
        for (const HoldSpan& hold : own.holds) cover(hold.begin, hold.end);
        if (all_.begin > all_.end || all_.length() / kBin >= kMostBins) return;
        std::vector<Rate> rates(static_cast<std::size_t>(num_bins()));
        for (const ExecutedPiece& piece : own.pieces) add(rates, piece, own.factor);
        for (const OthersSegment& segment : others)
            for (const ExecutedPiece& piece : segment.pieces) add(rates, piece, 1);
        Rate full;  // of pieces that go all through a bin
        there_before_.assign(1, nanoseconds{0});
        for (Rate& rate : rates) {
            full.work += rate.full_work;
            full.busy += rate.full_busy;
            const double work = full.work + rate.work, busy = full.busy + rate.busy;
            const bool is_there = work < kFull * std::min(busy, in_ns(kBin));
            there_before_.push_back(there_before_.back() + (is_there ? kBin : nanoseconds{0}));
        }
    }

    /// @returns for how long they were there
    nanoseconds in(const Span& span) const {
        if (there_before_.empty() || span.length().count() == 0) return nanoseconds{0};
        return there_until(span.end) - there_until(span.begin);
    }

  private:
    struct Rate {
        double work = 0, busy = 0;
        double full_work = 0, full_busy = 0;  ///< more than in the bin before
    };

    std::int64_t num_bins() const { return (all_.end - all_.begin) / kBin + 1; }
    nanoseconds begin_of(std::int64_t bin) const { return all_.begin + bin * kBin; }

    /// A few bins a piece, however long it is.
    void add(std::vector<Rate>& rates, const ExecutedPiece& piece, double factor) const {
        const Span span = common(span_of(piece), {all_.begin, begin_of(num_bins())});
        if (span.length().count() == 0) return;
        const double speed = factor * in_ns(piece.work) / in_ns(piece.took());
        const auto first = static_cast<std::size_t>((span.begin - all_.begin) / kBin);
        const auto last = static_cast<std::size_t>((span.end - nanoseconds{1} - all_.begin) / kBin);
        const auto add_part = [&](std::size_t bin) {
            const nanoseconds at = begin_of(static_cast<std::int64_t>(bin));
            const double time = in_ns(common(span, {at, at + kBin}).length());
            rates[bin].work += speed * time;
            rates[bin].busy += time;
        };
        add_part(first);
        if (last == first) return;
        add_part(last);
        rates[first + 1].full_work += speed * in_ns(kBin);
        rates[first + 1].full_busy += in_ns(kBin);
        rates[last].full_work -= speed * in_ns(kBin);
        rates[last].full_busy -= in_ns(kBin);
    }

    nanoseconds there_until(nanoseconds time) const {
        const nanoseconds since = std::clamp(time, all_.begin, begin_of(num_bins())) - all_.begin;
        const auto bin = static_cast<std::size_t>(since / kBin);
        const nanoseconds before = there_before_[bin];
        const bool is_there = bin + 1 < there_before_.size() && there_before_[bin + 1] > before;
        return before + (is_there ? since % kBin : nanoseconds{0});
    }

    Span all_{nanoseconds::max(), nanoseconds::min()};
    std::vector<nanoseconds> there_before_;  ///< by bin: up to its begin
};

class Account {
  public:
    Account(const FramesWork& own, const std::vector<OthersSegment>& others)
        : own_(own),
          others_(others),
          bystanders_(own, others),
          spans_(SpansOfFrame::of(own.pieces)) {
        int last = kNoChain;
        for (const OthersSegment& other : others) last = std::max(last, other.chain);
        for (const HoldSpan& hold : own.holds) last = std::max(last, hold.behind);
        for (int chain = kUnknownChain; chain <= last; ++chain) found_.push_back({.chain = chain});
    }

    LostTime sum_up() {
        LostTime lost;
        lost.pairs_of_pieces = look_beside();
        lost.by_itself = own_.longer ? share_longer(*own_.longer) : share_planned();
        if (own_.all_longer) lost.by_itself = raise_to(*own_.all_longer, lost.by_itself);
        lost.pairs_of_holds = share_holds();
        for (const LostTo& its : found_)
            if ((its.held + its.taken() + its.waited).count() > 0) lost.others.push_back(its);
        return lost;
    }

  private:
    using Kind = nanoseconds LostTo::*;

    /// Who was there while a piece was to be executed.
    struct Part {
        std::size_t mine;
        int chain;
        Kind kind;
        nanoseconds executes;
        nanoseconds waits;  ///< or executes
    };
    /// The sums over its parts.
    struct Beside {
        nanoseconds executes{0}, waits{0};
    };

    LostTo& found(int chain) { return found_[static_cast<std::size_t>(chain - kUnknownChain)]; }

    Kind kind_of(const OthersSegment& other, const ExecutedPiece& its,
                 const ExecutedPiece& mine) const {
        if (other.chain == own_.waits_for) return &LostTo::waited;
        if (other.deadline < own_.deadline) return &LostTo::by_urgent;
        return its.begin > mine.begin && other.first_priority <= own_.last_priority
                   ? &LostTo::by_priority
                   : &LostTo::by_kernel;
    }

    /// Calls act(const Part&) for each. Twice is quicker than to keep them.
    template <typename Act>
    std::size_t for_each_part(Act&& act) const {
        const std::size_t num = spans_.for_each_beside(
            others_, [&](std::size_t i, const OthersSegment& other, const ExecutedPiece& its) {
                const ExecutedPiece& mine = own_.pieces[i];
                const Span span = span_of(mine);
                act(Part{i, other.chain, kind_of(other, its, mine),
                         common(span, executing(its)).length(),
                         common(span, span_of(its)).length()});
            });
        for (std::size_t i = 0; i < own_.pieces.size(); ++i)
            if (const auto there = bystanders_.in(span_of(own_.pieces[i])); there.count() > 0)
                act(Part{i, kNoChain, &LostTo::by_urgent, there, there});
        return num;
    }

    std::size_t look_beside() {
        beside_.resize(own_.pieces.size());
        return for_each_part([&](const Part& part) {
            beside_[part.mine].executes += part.executes;
            beside_[part.mine].waits += part.waits;
        });
    }

    void share(nanoseconds lost, const Part& part, nanoseconds time, nanoseconds all) {
        if (all.count() == 0 || lost.count() <= 0) return;
        found(part.chain).*part.kind += to_ns(in_ns(lost) * in_ns(time) / in_ns(all));
    }

    /// @returns how many times as long as planned its own kernels take, from pieces beside no other
    double own_ratio() const {
        std::vector<std::pair<double, nanoseconds>> ratios;
        nanoseconds alone{0}, all{0};
        for (std::size_t i = 0; i < own_.pieces.size(); ++i) {
            const ExecutedPiece& piece = own_.pieces[i];
            all += piece.work;
            if (is_beside(i)) continue;
            alone += piece.work;
            ratios.emplace_back(in_ns(piece.took()) / in_ns(piece.work), piece.work);
        }
        if (in_ns(alone) <= kEnough * in_ns(all)) return std::max(own_.factor, 1.0);
        std::sort(ratios.begin(), ratios.end());
        nanoseconds so_far{0};
        for (const auto& [ratio, work] : ratios)
            if ((so_far += work) >= alone / 2) return std::max(ratio, 1.0);
        return 1;
    }

    bool is_beside(std::size_t i) const {
        return in_ns(beside_[i].waits) > kBeside * in_ns(own_.pieces[i].took());
    }

    /// @returns what it lost by itself
    nanoseconds share_planned() {
        const double ratio = own_ratio();
        nanoseconds by_itself{0};
        std::vector<nanoseconds> to_others(own_.pieces.size());
        for (std::size_t i = 0; i < own_.pieces.size(); ++i) {
            const ExecutedPiece& piece = own_.pieces[i];
            const nanoseconds lost = std::max(piece.took() - piece.work, nanoseconds{0});
            const nanoseconds its =
                is_beside(i) ? std::min(lost, to_ns((ratio - 1) * in_ns(piece.work))) : lost;
            by_itself += its;
            to_others[i] = lost - its;
        }
        for_each_part([&](const Part& part) {
            const Beside& all = beside_[part.mine];
            const bool did = all.executes.count() > 0;
            share(to_others[part.mine], part, did ? part.executes : part.waits,
                  did ? all.executes : all.waits);
        });
        return std::max(by_itself - own_.gaps, nanoseconds{0});
    }

    nanoseconds share_longer(nanoseconds longer) {
        nanoseconds all{0};
        for (const Beside& each : beside_) all += each.executes;
        const nanoseconds taken = std::min(longer, all);
        for_each_part([&](const Part& part) { share(taken, part, part.executes, all); });
        if (!own_.beside_bystanders || taken == longer) return longer - taken;
        found(kNoChain).by_urgent += longer - taken;
        return nanoseconds{0};
    }

    /// What is known to be lost stands for all that was, in proportion.
    /// @returns what it lost by itself
    nanoseconds raise_to(nanoseconds all, nanoseconds by_itself) {
        nanoseconds known = by_itself;
        for (const LostTo& its : found_) known += its.taken() + its.waited;
        if (all <= known) return by_itself;
        if (known.count() == 0) return all;
        const double times = in_ns(all) / in_ns(known);
        for (LostTo& its : found_)
            for (const Kind kind :
                 {&LostTo::by_urgent, &LostTo::by_kernel, &LostTo::by_priority, &LostTo::waited})
                its.*kind = to_ns(times * in_ns(its.*kind));
        return to_ns(times * in_ns(by_itself));
    }

    // A hold is what is left of it beside its own work.
    std::size_t share_holds() {
        std::vector<HoldSpan> left;
        const auto add = [&](nanoseconds begin, nanoseconds end, int behind) {
            if (begin < end) left.push_back({begin, end, behind});
        };
        for (const HoldSpan& hold : own_.holds) {
            nanoseconds at = hold.begin;
            for_each_in(own_.pieces, {hold.begin, hold.end}, [&](const ExecutedPiece& mine) {
                add(at, mine.begin, hold.behind);
                at = std::max(at, mine.end);
            });
            add(at, hold.end, hold.behind);
        }
        std::sort(left.begin(), left.end(),
                  [](const HoldSpan& a, const HoldSpan& b) { return a.begin < b.begin; });
        std::vector<Span> spans;
        for (const HoldSpan& hold : left) spans.push_back({hold.begin, hold.end});
        std::vector<nanoseconds> executed(left.size());
        const std::size_t num = SpansOfFrame(spans).for_each_beside(
            others_, [&](std::size_t i, const OthersSegment& other, const ExecutedPiece& its) {
                const nanoseconds time = common(spans[i], executing(its)).length();
                found(other.chain).held += time;
                executed[i] += time;
            });
        for (std::size_t i = 0; i < left.size(); ++i) {
            const nanoseconds there = bystanders_.in(spans[i]);
            found(kNoChain).held += there;
            executed[i] += there;
            if (executed[i] < spans[i].length())
                found(left[i].behind).held += spans[i].length() - executed[i];
        }
        const auto most =
            std::max_element(found_.begin(), found_.end(),
                             [](const LostTo& a, const LostTo& b) { return a.held < b.held; });
        most->held += own_.held_before;  // of equals the first: not known
        return num;
    }

    const FramesWork& own_;
    const std::vector<OthersSegment>& others_;
    const Bystanders bystanders_;
    const SpansOfFrame spans_;
    std::vector<LostTo> found_;   ///< by chain, from kUnknownChain on
    std::vector<Beside> beside_;  ///< by own piece
};

}  // namespace

LostTime lost_time(FramesWork own, std::vector<OthersSegment> others) {
    const std::size_t num = SpansOfFrame::of(own.pieces).num_pairs(others);
    if (num > kManyPairs) {
        const auto fewer = [&](std::vector<ExecutedPiece>& pieces) {
            join(pieces, std::max<std::size_t>(pieces.size() * kManyPairs / num, 1));
        };
        fewer(own.pieces);
        for (OthersSegment& other : others) fewer(other.pieces);
    }
    return Account(own, others).sum_up();
}

}  // namespace urgengo::observe
