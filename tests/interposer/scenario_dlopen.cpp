// SPDX-License-Identifier: Apache-2.0
//
// The way of cudart: dlopen the driver by its name, ask for cuGetProcAddress_v2 by dlsym, and for
// everything else through that. Linked into a program that does not name the driver otherwise, too.
#include <dlfcn.h>

#include <string>

#include "tests/interposer/kernels.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

using GetProcAddress = CUresult (*)(const char*, void**, int, cuuint64_t,
                                    CUdriverProcAddressQueryResult*);

class Door {
  public:
    Door() {
        void* driver = dlopen("libcuda.so.1", RTLD_LAZY);
        say("driver opened: %d", driver != nullptr);
        if (!driver) return;
        ask_ = reinterpret_cast<GetProcAddress>(dlsym(driver, "cuGetProcAddress_v2"));
        say("door found: %d", ask_ != nullptr);
        // As cudart does it: from here on the answer to this question is the door.
        ask_ = reinterpret_cast<GetProcAddress>(find("cuGetProcAddress", 12000));
    }

    explicit operator bool() const { return ask_ != nullptr; }

    void* find(const char* name, int version, cuuint64_t flags = 0) const {
        void* function = nullptr;
        CUdriverProcAddressQueryResult status;
        if (ask_(name, &function, version, flags, &status) != CUDA_SUCCESS || !function)
            give_up(name, 0);
        return function;
    }

    template <typename Function>
    void find(Function& function, const char* name, int version, cuuint64_t flags = 0) const {
        function = reinterpret_cast<Function>(find(name, version, flags));
    }

  private:
    GetProcAddress ask_ = nullptr;
};

int dlopen_(const Arguments&) {
    const Door door;
    if (!door) return 0;
    CUresult (*init)(unsigned);
    CUresult (*retain)(CUcontext*, CUdevice);
    CUresult (*set_current)(CUcontext);
    CUresult (*load)(CUmodule*, const void*);
    CUresult (*get_function)(CUfunction*, CUmodule, const char*);
    CUresult (*allocate_host)(void**, size_t, unsigned);
    CUresult (*launch)(CUfunction, unsigned, unsigned, unsigned, unsigned, unsigned, unsigned,
                       unsigned, CUstream, void**, void**);
    decltype(launch) launch_ptsz;
    CUresult (*launch_ex)(const CUlaunchConfig*, CUfunction, void**, void**);
    CUresult (*synchronize)(CUstream);
    CUresult (*synchronize_context)();
    door.find(init, "cuInit", 2000);
    door.find(retain, "cuDevicePrimaryCtxRetain", 7000);
    door.find(set_current, "cuCtxSetCurrent", 4000);
    door.find(load, "cuModuleLoadData", 2000);
    door.find(get_function, "cuModuleGetFunction", 2000);
    door.find(allocate_host, "cuMemHostAlloc", 2020);
    door.find(launch, "cuLaunchKernel", 4000);
    door.find(launch_ptsz, "cuLaunchKernel", 7000, CU_GET_PROC_ADDRESS_PER_THREAD_DEFAULT_STREAM);
    door.find(launch_ex, "cuLaunchKernelEx", 11060);
    door.find(synchronize, "cuStreamSynchronize", 2000);
    door.find(synchronize_context, "cuCtxSynchronize", 2000);

    CUcontext context = nullptr;
    CUmodule module = nullptr;
    CUfunction store = nullptr;
    void* memory = nullptr;
    SHOW(init(0));
    SHOW(retain(&context, 0));
    SHOW(set_current(context));
    SHOW(load(&module, kImage));
    SHOW(get_function(&store, module, kStoreName));
    SHOW(allocate_host(&memory, 2 * sizeof(cuuint64_t), CU_MEMHOSTALLOC_DEVICEMAP));
    auto* words = static_cast<volatile cuuint64_t*>(memory);
    cuuint64_t to = reinterpret_cast<cuuint64_t>(memory), value = 50;
    void* parameters[] = {&to, &value, &value};
    const CUlaunchConfig config{1, 1, 1, 1, 1, 1, 0, nullptr, nullptr, 0};

    SHOW(launch(store, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters, nullptr));
    SHOW(synchronize(nullptr));
    say("%d", static_cast<int>(words[0]));
    value = 51;
    SHOW(launch_ptsz(store, 1, 1, 1, 1, 1, 1, 0, nullptr, parameters, nullptr));
    SHOW(synchronize_context());
    say("%d", static_cast<int>(words[0]));
    value = 52;
    SHOW(launch_ex(&config, store, parameters, nullptr));
    SHOW(synchronize_context());
    say("%d", static_cast<int>(words[0]));
    return 0;
}

const Scenario s1("dlopen", dlopen_);

}  // namespace
}  // namespace twin
