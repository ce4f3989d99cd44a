// SPDX-License-Identifier: Apache-2.0
//
// What marks cost, on a GPU that pauses between kernels.
#include "host/exec/mark_cost.h"

#include <map>

#include "tests/support/catch.h"
#include "tests/support/fake_driver.h"

using namespace urgengo;
using namespace urgengo::exec;
using namespace urgengo::testing;
using namespace std::chrono_literals;

namespace {

/// Executes, whenever it is asked whether it has, all that was launched. Times in nanoseconds.
class PausingGpu {
  public:
    PausingGpu() {
        current_ = this;
        driver.api.cuStreamCreateWithPriority = [](CUstream* stream, unsigned, int) {
            *stream = reinterpret_cast<CUstream>(0x77);
            return CUDA_SUCCESS;
        };
        driver.api.cuStreamDestroy_v2 = [](CUstream) { return CUDA_SUCCESS; };
        driver.api.cuLaunchKernel = [](CUfunction, unsigned, unsigned, unsigned, unsigned, unsigned,
                                       unsigned, unsigned, CUstream, void** parameters, void**) {
            current_->delays_[current_->driver.marks.size()] +=
                *static_cast<std::uint64_t*>(parameters[0]) + current_->pause_ns +
                current_->beyond_spin_ns;
            return CUDA_SUCCESS;
        };
        driver.is_over = [this] {
            ++num_measurements;
            execute();
            return true;
        };
    }

    MarkCost measured() {
        const MarkContext* context = marks_.prepare();
        REQUIRE(context);
        return measure_mark_cost(marks_, *context);
    }

    FakeDriver driver;
    std::uint64_t mark_ns = 700;  ///< without a pause
    std::uint64_t pause_ns = 1400;
    std::uint64_t beyond_spin_ns = kDelayBeyondSpin.count();  ///< of a delay
    std::uint64_t busy_ns = 0;             ///< somebody else's work before each mark ...
    int busy_until = 0;                    ///< ... in so many measurements, the first
    std::uint64_t per_measurement_ns = 0;  ///< the pause grows
    int num_measurements = 0;

  private:
    void execute() {
        for (std::size_t i = 0; !driver.marks.empty(); ++i) {
            driver.gpu_time_ns += mark_ns + pause_ns + delays_[i];
            if (num_measurements <= busy_until) driver.gpu_time_ns += busy_ns;
            driver.execute_marks(1);
        }
        delays_.clear();
        pause_ns += per_measurement_ns;
    }

    inline static PausingGpu* current_ = nullptr;
    ProgressMarks marks_{driver.api};
    std::map<std::size_t, std::uint64_t> delays_;  // by how many marks are before
};

}  // namespace

TEST_CASE("Cost of a mark is its step, and that of a kernel between two has a pause besides",
          "[exec][marks]") {
    PausingGpu gpu;
    const MarkCost cost = gpu.measured();
    CHECK(cost.mark == 2100ns);
    CHECK(cost.pause == 1400ns);
}

TEST_CASE("Cost of a mark is measured again, and not believed, when it is implausible",
          "[exec][marks]") {
    PausingGpu busy_once;
    busy_once.busy_ns = 200'000;
    busy_once.busy_until = 1;
    CHECK(busy_once.measured().mark == 2100ns);

    PausingGpu busy;
    busy.busy_ns = 200'000;
    busy.busy_until = 100;
    const MarkCost beside_others = busy.measured();
    CHECK(beside_others.mark == 0ns);
    CHECK(beside_others.pause == 0ns);

    PausingGpu timeless;
    timeless.mark_ns = timeless.pause_ns = 0;
    CHECK(timeless.measured().mark == 0ns);
}

TEST_CASE("Pause is not believed when it is none, too long, or another beside a longer kernel",
          "[exec][marks]") {
    const auto check = [](PausingGpu& gpu, std::chrono::nanoseconds mark) {
        const MarkCost cost = gpu.measured();
        CHECK(cost.mark == mark);
        CHECK(cost.pause == 0ns);
    };
    PausingGpu none;
    none.pause_ns = 0;
    check(none, 700ns);

    PausingGpu long_one;
    long_one.beyond_spin_ns = 2000;
    check(long_one, 2100ns);

    PausingGpu unstable;
    unstable.per_measurement_ns = 50;  // 200 from one kernel's measurements to the other's
    check(unstable, 2100ns);
}

TEST_CASE("Cost of a mark is unknown to a driver without what it takes", "[exec][marks]") {
    PausingGpu gpu;
    gpu.driver.api.cuStreamQuery = nullptr;
    const MarkCost cost = gpu.measured();
    CHECK(cost.mark == 0ns);
    CHECK(cost.pause == 0ns);
}
