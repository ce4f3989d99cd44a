// SPDX-License-Identifier: Apache-2.0
#include "host/observe/lost_time.h"

#include <algorithm>
#include <map>
#include <utility>

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

constexpr int kBystanders = -1;

struct Span {
    nanoseconds begin{0}, end{0};
    nanoseconds length() const { return std::max(end - begin, nanoseconds{0}); }
};

Span common(const Span& a, const Span& b) {
    return {std::max(a.begin, b.begin), std::min(a.end, b.end)};
}

Span span_of(const ExecutedPiece& piece) {
    return {piece.begin, piece.end};
}
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
        Span all{nanoseconds::max(), nanoseconds::min()};
        const auto cover = [&](nanoseconds begin, nanoseconds end) {
            all = {std::min(all.begin, begin), std::max(all.end, end)};
        };
        for (const ExecutedPiece& piece : own.pieces) cover(piece.begin, piece.end);
        for (const HoldSpan& hold : own.holds) cover(hold.begin, hold.end);
        if (all.begin > all.end || all.length() / kBin >= kMostBins) return;
        begin_ = all.begin;
        bins_.resize(static_cast<std::size_t>(all.length() / kBin + 1));
        std::vector<Rate> rates(bins_.size());
        for (const ExecutedPiece& piece : own.pieces) add(rates, piece, own.factor);
        for (const OthersSegment& segment : others)
            for (const ExecutedPiece& piece : segment.pieces) add(rates, piece, 1);
        for (std::size_t i = 0; i < rates.size(); ++i)
            bins_[i] = rates[i].work < kFull * std::min(rates[i].busy, in_ns(kBin));
    }

    /// @returns for how long they were there
    nanoseconds in(const Span& span) const {
        nanoseconds time{0};
        for_each_bin(span, [&](std::size_t bin, const Span& part) {
            if (bins_[bin]) time += part.length();
        });
        return time;
    }

  private:
    struct Rate {
        double work = 0, busy = 0;
    };

    template <typename Act>
    void for_each_bin(const Span& span, Act&& act) const {
        const std::int64_t first = std::max<std::int64_t>((span.begin - begin_) / kBin, 0);
        for (auto i = static_cast<std::size_t>(first); i < bins_.size(); ++i) {
            const nanoseconds at = begin_ + static_cast<std::int64_t>(i) * kBin;
            if (at >= span.end) return;
            act(i, common(span, {at, at + kBin}));
        }
    }
    void add(std::vector<Rate>& rates, const ExecutedPiece& piece, double factor) const {
        const double speed = factor * in_ns(piece.work) / in_ns(piece.took());
        for_each_bin(span_of(piece), [&](std::size_t bin, const Span& part) {
            rates[bin].work += speed * in_ns(part.length());
            rates[bin].busy += in_ns(part.length());
        });
    }

    nanoseconds begin_{0};
    std::vector<bool> bins_;
};

/// What is told of a chain, while it is summed up.
using ByChain = std::map<int, LostTo>;

class Account {
  public:
    Account(const FramesWork& own, const std::vector<OthersSegment>& others)
        : own_(own), others_(others), bystanders_(own, others) {}

    LostTime sum_up() {
        std::vector<Beside> beside;
        beside.reserve(own_.pieces.size());
        for (const ExecutedPiece& piece : own_.pieces) beside.push_back(beside_of(piece));
        LostTime lost;
        lost.by_itself = own_.longer ? share_longer(*own_.longer, beside) : share_planned(beside);
        share_holds();
        for (auto& [chain, its] : found_) {
            its.chain = chain;
            lost.others.push_back(its);
        }
        return lost;
    }

  private:
    using Kind = nanoseconds LostTo::*;

    /// Who was there while a piece was to be executed.
    struct Part {
        int chain;
        Kind kind;
        nanoseconds time;
    };
    struct Beside {
        std::vector<Part> executing;
        std::vector<Part> waiting;  ///< or executing
    };

    static nanoseconds sum(const std::vector<Part>& parts) {
        nanoseconds time{0};
        for (const Part& part : parts) time += part.time;
        return time;
    }

    Kind kind_of(const OthersSegment& other, const ExecutedPiece& its,
                 const ExecutedPiece& mine) const {
        if (other.chain == own_.waits_for) return &LostTo::waited;
        if (other.deadline < own_.deadline) return &LostTo::by_urgent;
        return its.begin > mine.begin && other.first_priority <= own_.last_priority
                   ? &LostTo::by_priority
                   : &LostTo::by_kernel;
    }

    Beside beside_of(const ExecutedPiece& mine) const {
        Beside beside;
        const Span span = span_of(mine);
        for (const OthersSegment& other : others_)
            for_each_in(other.pieces, span, [&](const ExecutedPiece& its) {
                const Kind kind = kind_of(other, its, mine);
                const nanoseconds executes = common(span, executing(its)).length();
                if (executes.count() > 0) beside.executing.push_back({other.chain, kind, executes});
                beside.waiting.push_back({other.chain, kind, common(span, span_of(its)).length()});
            });
        if (const nanoseconds there = bystanders_.in(span); there.count() > 0) {
            beside.executing.push_back({kBystanders, &LostTo::by_urgent, there});
            beside.waiting.push_back(beside.executing.back());
        }
        return beside;
    }

    void share(nanoseconds lost, const std::vector<Part>& parts) {
        const nanoseconds all = sum(parts);
        if (all.count() == 0 || lost.count() <= 0) return;
        for (const Part& part : parts)
            found_[part.chain].*part.kind += to_ns(in_ns(lost) * in_ns(part.time) / in_ns(all));
    }

    /// @returns how many times as long as planned its own kernels take, from pieces beside no other
    double own_ratio(const std::vector<bool>& is_beside) const {
        std::vector<std::pair<double, nanoseconds>> ratios;
        nanoseconds alone{0}, all{0};
        for (std::size_t i = 0; i < own_.pieces.size(); ++i) {
            const ExecutedPiece& piece = own_.pieces[i];
            all += piece.work;
            if (is_beside[i]) continue;
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

    /// @returns what it lost by itself
    nanoseconds share_planned(const std::vector<Beside>& beside) {
        std::vector<bool> is_beside;
        for (std::size_t i = 0; i < beside.size(); ++i)
            is_beside.push_back(in_ns(sum(beside[i].waiting)) >
                                kBeside * in_ns(own_.pieces[i].took()));
        const double ratio = own_ratio(is_beside);
        nanoseconds by_itself{0};
        for (std::size_t i = 0; i < beside.size(); ++i) {
            const ExecutedPiece& piece = own_.pieces[i];
            const nanoseconds lost = std::max(piece.took() - piece.work, nanoseconds{0});
            if (!is_beside[i]) {
                by_itself += lost;
                continue;
            }
            const nanoseconds its = std::min(lost, to_ns((ratio - 1) * in_ns(piece.work)));
            by_itself += its;
            share(lost - its,
                  beside[i].executing.empty() ? beside[i].waiting : beside[i].executing);
        }
        return std::max(by_itself - own_.gaps, nanoseconds{0});
    }

    nanoseconds share_longer(nanoseconds longer, const std::vector<Beside>& beside) {
        std::vector<Part> all;
        for (const Beside& each : beside)
            all.insert(all.end(), each.executing.begin(), each.executing.end());
        const nanoseconds taken = std::min(longer, sum(all));
        share(taken, all);
        if (!own_.beside_bystanders || taken == longer) return longer - taken;
        found_[kBystanders].by_urgent += longer - taken;
        return nanoseconds{0};
    }

    // A hold is what is left of it beside its own work.
    void share_holds() {
        for (const HoldSpan& hold : own_.holds) {
            nanoseconds at = hold.begin;
            for_each_in(own_.pieces, {hold.begin, hold.end}, [&](const ExecutedPiece& mine) {
                share_hold({at, mine.begin}, hold.behind);
                at = std::max(at, mine.end);
            });
            share_hold({at, hold.end}, hold.behind);
        }
    }
    void share_hold(const Span& span, int behind) {
        if (span.length().count() == 0) return;
        nanoseconds executed{0};
        for (const OthersSegment& other : others_)
            for_each_in(other.pieces, span, [&](const ExecutedPiece& its) {
                const nanoseconds time = common(span, executing(its)).length();
                found_[other.chain].held += time;
                executed += time;
            });
        if (const nanoseconds there = bystanders_.in(span); there.count() > 0) {
            found_[kBystanders].held += there;
            executed += there;
        }
        if (executed < span.length()) found_[behind].held += span.length() - executed;
    }

    const FramesWork& own_;
    const std::vector<OthersSegment>& others_;
    const Bystanders bystanders_;
    ByChain found_;
};

}  // namespace

LostTime lost_time(const FramesWork& own, const std::vector<OthersSegment>& others) {
    return Account(own, others).sum_up();
}

}  // namespace urgengo::observe
