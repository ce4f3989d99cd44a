// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/least_misses.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <vector>

#include "tools/chains/arrivals.h"
#include "tools/sim/gpu_model.h"
#include "tools/sim/workloads.h"

namespace urgengo::sim {
namespace {

/// Longer stretches are not looked at.
constexpr double kLongestMs = 4000;

struct Window {
    double begin_ms, end_ms;
    std::size_t chain;
};

/// By chain.
struct ChainCost {
    double work_ms = 0;  ///< of a frame
    double weight = 0;   ///< of a miss
};

/// @param shared  the blocks' work alone
double work_ms(const chains::Chain& chain, bool shared) {
    const GpuShape shape;
    double sum_ns = 0;
    for (const chains::Task& task : chain.tasks)
        for (const chains::Kernel& kernel : task.kernels) {
            const KernelWork work = work_of(kernel, shape);
            sum_ns += shared ? work.block_ns * work.blocks / shape.num_sms
                             : GpuModel::time_alone_ns(shape, work.blocks, work.block_threads,
                                                       work.block_ns);
        }
    return sum_ns / 1e6;
}

/// What giving up so much work costs at least, of frames that each chain has so many of.
class Knapsack {
  public:
    explicit Knapsack(const std::vector<ChainCost>& chains)
        : chains_(chains), order_(chains.size()) {
        std::iota(order_.begin(), order_.end(), std::size_t{0});
        std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
            return chains[a].weight * chains[b].work_ms < chains[b].weight * chains[a].work_ms;
        });
    }
    double cost(const std::vector<int>& frames, double excess_ms) const {
        double cost = 0;
        // Whole frames, too: so many of the largest, each as cheap as the cheapest.
        double largest_ms = 0, cheapest = 1;
        for (std::size_t i = 0; i < chains_.size(); ++i) {
            if (frames[i] == 0) continue;
            largest_ms = std::max(largest_ms, chains_[i].work_ms);
            cheapest = std::min(cheapest, chains_[i].weight);
        }
        const double whole = std::ceil(excess_ms / largest_ms) * cheapest;
        for (const std::size_t i : order_) {
            if (excess_ms <= 0) break;
            const double all_ms = frames[i] * chains_[i].work_ms;
            if (all_ms <= 0) continue;
            const double part = std::min(1.0, excess_ms / all_ms);
            cost += part * frames[i] * chains_[i].weight;
            excess_ms -= part * all_ms;
        }
        return std::max(cost, whole);
    }

  private:
    const std::vector<ChainCost>& chains_;
    std::vector<std::size_t> order_;  ///< the cheapest for its work first
};

/// @param windows  by their ends
double bound(const std::vector<Window>& windows, const std::vector<ChainCost>& chains) {
    const Knapsack knapsack(chains);
    std::vector<double> begins;
    for (const Window& window : windows) begins.push_back(window.begin_ms);
    std::sort(begins.begin(), begins.end());
    // From the last begin to the first one: the most that can be known to be lost from there on.
    std::map<double, double> lost_from;
    double best = 0;
    const auto after = [&](double ms) {
        const auto at = lost_from.lower_bound(ms);
        return at == lost_from.end() ? 0.0 : at->second;
    };
    std::vector<int> frames(chains.size());
    for (std::size_t b = begins.size(); b-- > 0;) {
        const double begin_ms = begins[b];
        std::fill(frames.begin(), frames.end(), 0);
        double sum_ms = 0;
        for (auto window =
                 std::lower_bound(windows.begin(), windows.end(), begin_ms,
                                  [](const Window&w, double ms) { return w.end_ms < ms; });
             window != windows.end() && window->end_ms <= begin_ms + kLongestMs; ++window) {
            if (window->begin_ms < begin_ms) continue;
            ++frames[window->chain];
            sum_ms += chains[window->chain].work_ms;
            const double excess_ms = sum_ms - (window->end_ms - begin_ms);
            if (excess_ms <= 0) continue;
            best = std::max(best, knapsack.cost(frames, excess_ms) + after(window->end_ms));
        }
        lost_from[begin_ms] = best;
    }
    return best;
}

}  // namespace

LeastMisses least_misses(const chains::Workload& workload, const chains::Scenario& scenario,
                         double seconds, std::uint32_t seed) {
    const auto ns = [](double ms) {
        return std::chrono::nanoseconds(static_cast<std::int64_t>(ms * 1e6));
    };
    std::vector<Window> windows;
    std::vector<ChainCost> alone, shared;
    for (const chains::Chain& chain : workload.chains) {
        const auto frames = chains::plan_frames(
            chain, chain.place,
            {seed, ns(scenario.period_ms(chain)), ns(seconds * 1000), workload.variable});
        const double weight =
            frames.empty() ? 0 : 1.0 / double(frames.size()) / double(workload.chains.size());
        for (const chains::PlannedFrame& frame : frames) {
            const double arrival_ms = double(frame.arrival.count()) / 1e6;
            const double cpu_ms = double(frame.cpu.front().count()) / 1e6;
            windows.push_back(
                {arrival_ms + cpu_ms, arrival_ms + scenario.deadline_ms(chain), alone.size()});
        }
        alone.push_back({work_ms(chain, false), weight});
        shared.push_back({work_ms(chain, true), weight});
    }
    std::sort(windows.begin(), windows.end(),
              [](const Window& a, const Window& b) { return a.end_ms < b.end_ms; });
    return {bound(windows, alone), bound(windows, shared)};
}

}  // namespace urgengo::sim
