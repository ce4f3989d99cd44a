// SPDX-License-Identifier: Apache-2.0
//
// Order of launches that programs use less: those of old, cooperative ones, those for several
// devices.
#include "tests/interposer/mixer.h"

namespace twin {
namespace {

using LaunchMulti = CUresult(CUDA_LAUNCH_PARAMS*, unsigned, unsigned);
constexpr const char* kLaunchMulti = "cuLaunchCooperativeKernelMultiDevice";

/// A launch as it was before cuLaunchKernel: its shape and parameters are the function's.
struct OldLaunches {
    CUresult (*set_shape)(CUfunction, int, int,
                          int) = find<CUresult(CUfunction, int, int, int)>("cuFuncSetBlockShape",
                                                                           2000);
    CUresult (*set_shared)(CUfunction,
                           unsigned) = find<CUresult(CUfunction, unsigned)>("cuFuncSetSharedSize",
                                                                            2000);
    CUresult (*set_size)(CUfunction,
                         unsigned) = find<CUresult(CUfunction, unsigned)>("cuParamSetSize", 2000);
    CUresult (*set_v)(CUfunction, int, void*,
                      unsigned) = find<CUresult(CUfunction, int, void*, unsigned)>("cuParamSetv",
                                                                                   2000);
    CUresult (*set_i)(CUfunction, int,
                      unsigned) = find<CUresult(CUfunction, int, unsigned)>("cuParamSeti", 2000);
    CUresult (*launch)(CUfunction) = find<CUresult(CUfunction)>("cuLaunch", 2000);
    CUresult (*launch_grid)(CUfunction, int,
                            int) = find<CUresult(CUfunction, int, int)>("cuLaunchGrid", 2000);
    CUresult (*launch_async)(CUfunction, int, int, CUstream) =
        find<CUresult(CUfunction, int, int, CUstream)>("cuLaunchGridAsync", 2000);

    explicit operator bool() const {
        return set_shape && set_shared && set_size && set_v && set_i && launch && launch_grid &&
               launch_async;
    }
};

/// @returns false if one of them is refused
bool prepare(const OldLaunches& old, const Mixer& mixer) {
    CUdeviceptr to = on_gpu(mixer.word);
    return STEP(old.set_shape(mixer.mix, 1, 1, 1)) == CUDA_SUCCESS &&
           STEP(old.set_shared(mixer.mix, 0)) == CUDA_SUCCESS &&
           STEP(old.set_size(mixer.mix, 16)) == CUDA_SUCCESS &&
           STEP(old.set_v(mixer.mix, 0, &to, sizeof to)) == CUDA_SUCCESS &&
           STEP(old.set_i(mixer.mix, 8, 1)) == CUDA_SUCCESS &&
           STEP(old.set_i(mixer.mix, 12, 0)) == CUDA_SUCCESS;
}

// On a stream that is named.
int old_async(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        const OldLaunches old;
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(2, stream));
        if (old && prepare(old, mixer)) {
            STEP(old.launch_async(mixer.mix, 1, 1, stream));
            STEP(mixer.launch_wide(stream));
            STEP(old.launch_async(mixer.mix, 1, 1, stream));
            STEP(old.launch_async(mixer.mix, 0, 1, stream));
        }
        STEP(mixer.launch(3, stream));
        STEP(cuStreamSynchronize(stream));
    });
}

// On the legacy stream, for which the stream waits, and the other way about.
int old_launches(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        const OldLaunches old;
        unsigned flags = 0;
        // Unordered with the legacy stream's, the launches would race here.
        if (STEP(cuStreamGetFlags(stream, &flags)) || flags == CU_STREAM_NON_BLOCKING) return;
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(2, stream));
        if (old && prepare(old, mixer)) {
            STEP(old.launch(mixer.mix));
            STEP(mixer.launch(4, stream));
        }
        // cuLaunchKernel invalidates what was set before (cuda.h).
        if (old && prepare(old, mixer)) {
            STEP(old.launch_grid(mixer.mix, 1, 1));
            STEP(old.launch_grid(mixer.mix, 0, 1));
        }
        STEP(mixer.launch(5, stream));
        STEP(cuLaunchHostFunc(stream, add_seven, mixer.word));
        STEP(cuStreamSynchronize(stream));
        STEP(cuCtxSynchronize());
    });
}

int cooperative(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        CUdeviceptr to = on_gpu(mixer.word);
        std::uint64_t value = 1;
        void* parameters[] = {&to, &value};
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(2, stream));
        STEP(cuLaunchCooperativeKernel(mixer.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters));
        STEP(mixer.launch(3, stream));
        STEP(cuStreamSynchronize(stream));
    });
}

// The default streams are refused.
int multi_device(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        auto* const launch_multi = find<LaunchMulti>(kLaunchMulti, 9000);
        CUdeviceptr to = on_gpu(mixer.word);
        std::uint64_t value = 1;
        void* parameters[] = {&to, &value};
        CUDA_LAUNCH_PARAMS launch{mixer.mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters};
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(2, stream));
        if (launch_multi) STEP(launch_multi(&launch, 1, 0));
        STEP(mixer.launch(3, stream));
        STEP(cuStreamSynchronize(stream));
    });
}

// Launches for no device, and from nowhere.
int multi_device_none(const Arguments&) {
    return on_every_stream([](const Mixer& mixer, CUstream stream) {
        auto* const launch_multi = find<LaunchMulti>(kLaunchMulti, 9000);
        CUDA_LAUNCH_PARAMS launch{};
        STEP(mixer.launch_wide(stream));
        STEP(mixer.launch(2, stream));
        if (launch_multi) {
            STEP(launch_multi(&launch, 0, 0));
            STEP(launch_multi(nullptr, 1, 0));
        }
        STEP(mixer.launch(3, stream));
        STEP(cuStreamSynchronize(stream));
    });
}

const Scenario s1("order_old_async", old_async), s2("order_old_launches", old_launches),
    s3("order_cooperative", cooperative), s4("order_multi_device", multi_device),
    s5("order_multi_device_none", multi_device_none);

}  // namespace
}  // namespace twin
