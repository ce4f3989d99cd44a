// SPDX-License-Identifier: Apache-2.0
//
// Does a mark that is launched with programmatic stream serialisation come after all that is before
// it on its stream, and before all that is behind it (host/exec/progress_marks.h)? With the mark
// itself. One line a case, "EARLY" where it does not; exit status 1 if there is one, 77 on a GPU
// without such launches.
#include <cuda_runtime.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>

#include "device/marks.cu"

namespace {

constexpr std::uint64_t kLong_ns = 300'000, kShort_ns = 1'000;
constexpr std::size_t kBigCopy = 512u << 20;
constexpr int kRounds = 20;

#define MUST(call) must((call), #call)
void must(cudaError_t result, const char* call) {
    if (result == cudaSuccess) return;
    std::printf("%s: %s\n", call, cudaGetErrorString(result));
    std::exit(2);
}

__device__ std::uint64_t gpu_time() {
    std::uint64_t ns;
    asm volatile("mov.u64 %0, %globaltimer;" : "=l"(ns));
    return ns;
}

/// Lets its dependents start at once, ends after so long, and says when.
__global__ void kernel(std::uint64_t* end, std::uint64_t ns, bool lets_dependents_start,
                       bool waits_first) {
#if __CUDA_ARCH__ >= 900
    if (waits_first) asm volatile("griddepcontrol.wait;" ::: "memory");
    if (lets_dependents_start) asm volatile("griddepcontrol.launch_dependents;");
#endif
    const std::uint64_t begin = gpu_time();
    while (gpu_time() - begin < ns) {
    }
    *static_cast<volatile std::uint64_t*>(end) = gpu_time();
}

__global__ void behind(std::uint64_t* began) {
    *static_cast<volatile std::uint64_t*>(began) = gpu_time();
}

/// What the GPU writes.
struct Times {
    alignas(16) std::uint64_t line[2];  ///< the mark's words, which it writes at once
    std::uint64_t end;                  ///< of what is before the mark
    std::uint64_t began;                ///< what is behind it
    std::uint64_t other;
};
Times* times = nullptr;

template <typename Kernel, typename... Arguments>
void launch_overlapping(cudaStream_t stream, Kernel* which, Arguments... arguments) {
    cudaLaunchAttribute attribute{};
    attribute.id = cudaLaunchAttributeProgrammaticStreamSerialization;
    attribute.val.programmaticStreamSerializationAllowed = 1;
    cudaLaunchConfig_t config{};
    config.gridDim = config.blockDim = 1;
    config.stream = stream;
    config.attrs = &attribute;
    config.numAttrs = 1;
    MUST(cudaLaunchKernelEx(&config, which, arguments...));
}

/// A long kernel that lets what comes next start early.
void launch_long(cudaStream_t stream, std::uint64_t* end = &times->end) {
    kernel<<<1, 1, 0, stream>>>(end, kLong_ns, true, false);
}

int num_early = 0;

template <typename Before>
void check(const char* name, cudaStream_t stream, Before&& before) {
    bool early = false;
    for (int round = 0; round < kRounds && !early; ++round) {
        *times = {};
        before();
        launch_overlapping(stream, urgengo_mark, times->line, std::uint64_t{0}, std::uint64_t{0});
        behind<<<1, 1, 0, stream>>>(&times->began);
        MUST(cudaDeviceSynchronize());
        // The stamp has lost its highest 16 bits.
        const std::uint64_t end = times->end << 16 >> 16, mark = times->line[1] >> 16,
                            began = times->began << 16 >> 16;
        early = end == 0 || mark < end || began < mark;
        if (early || round == kRounds - 1)
            std::printf("%-44s %-6s mark %+lld ns after the end, next %+lld ns\n", name,
                        early ? "EARLY" : "ok", static_cast<long long>(mark - end),
                        static_cast<long long>(began - end));
    }
    num_early += early;
}

void check_all() {
    cudaStream_t s, other, none = nullptr;
    MUST(cudaStreamCreateWithFlags(&s, cudaStreamNonBlocking));
    MUST(cudaStreamCreate(&other));
    cudaEvent_t event;
    MUST(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
    char *from, *to;
    MUST(cudaMalloc(&from, kBigCopy));
    MUST(cudaMalloc(&to, kBigCopy));
    cudaGraph_t graph;
    cudaGraphExec_t executable;
    MUST(cudaStreamBeginCapture(s, cudaStreamCaptureModeRelaxed));
    launch_long(s, &times->other);
    launch_long(s);
    MUST(cudaStreamEndCapture(s, &graph));
    MUST(cudaGraphInstantiate(&executable, graph, 0));

    check("kernel", s, [&] { kernel<<<1, 1, 0, s>>>(&times->end, kLong_ns, false, false); });
    check("kernel that lets dependents start", s, [&] { launch_long(s); });
    check("dependent kernel that waits", s, [&] {
        launch_long(s, &times->other);
        launch_overlapping(s, kernel, &times->end, kShort_ns, true, true);
    });
    check("graph", s, [&] { MUST(cudaGraphLaunch(executable, s)); });
    check("copy behind a kernel", s, [&] {
        launch_long(s);
        MUST(cudaMemcpyAsync(to, from, kBigCopy, cudaMemcpyDeviceToDevice, s));
    });
    check("copy that writes the end", s, [&] {
        launch_long(s, &times->other);
        MUST(cudaMemcpyAsync(&times->end, &times->other, 8, cudaMemcpyDefault, s));
    });
    check("kernel behind a memset", s, [&] {
        MUST(cudaMemsetAsync(to, 1, kBigCopy, s));
        kernel<<<1, 1, 0, s>>>(&times->end, kShort_ns, true, false);
    });
    const auto wait_for_other = [&] {
        launch_long(other);
        MUST(cudaEventRecord(event, other));
        MUST(cudaStreamWaitEvent(s, event, 0));
    };
    check("event of another stream", s, wait_for_other);
    check("event of another stream, behind a kernel", s, [&] {
        kernel<<<1, 1, 0, s>>>(&times->other, kShort_ns, true, false);
        wait_for_other();
    });
    check("host function", s, [&] {
        launch_long(s);
        MUST(cudaLaunchHostFunc(
            s, [](void*) {}, nullptr));
    });
    check("legacy stream, behind a blocking one", none, [&] { launch_long(other); });
    check("blocking stream, behind the legacy one", other, [&] { launch_long(none); });
    check("legacy stream", none, [&] { launch_long(none); });
    check("per-thread stream", cudaStreamPerThread, [&] { launch_long(cudaStreamPerThread); });
}

}  // namespace

int main() {
    int major = 0;
    MUST(cudaDeviceGetAttribute(&major, cudaDevAttrComputeCapabilityMajor, 0));
    if (major < 9) return 77;
    MUST(cudaHostAlloc(&times, sizeof *times, cudaHostAllocMapped));
    check_all();
    std::printf("%d early\n", num_early);
    return num_early > 0;
}
