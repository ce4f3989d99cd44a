// SPDX-License-Identifier: Apache-2.0
//
// Which context is current: launches on a default stream are its own. After each of these calls the
// thread's next launch is asked about, so those that need no asking
// (runtime/planned_launches.cpp) need not ask the driver for the context either, which takes 40 of
// 120 ns in a real program (PyTorch, H200's host, 2026-11-22). What creates contexts for graphics
// is not among them: what such a thread launches next is asked about as late as at its next mark.
#include "interposer/boundary.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;

namespace {

CUresult and_ask_again(CUresult result) {
    if (t_this.state && !t_this.line.inside) t_this.state->line.ask_again();
    return result;
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuCtxCreate
#undef cuCtxPopCurrent
#undef cuCtxPushCurrent

extern "C" {

CUresult CUDAAPI cuCtxSetCurrent(CUcontext context) {
    return and_ask_again(real().cuCtxSetCurrent(context));
}

CUresult CUDAAPI cuCtxPushCurrent(CUcontext context) {
    return and_ask_again(real().cuCtxPushCurrent_v1(context));
}

CUresult CUDAAPI cuCtxPushCurrent_v2(CUcontext context) {
    return and_ask_again(real().cuCtxPushCurrent_v2(context));
}

CUresult CUDAAPI cuCtxPopCurrent(CUcontext* context) {
    return and_ask_again(real().cuCtxPopCurrent_v1(context));
}

CUresult CUDAAPI cuCtxPopCurrent_v2(CUcontext* context) {
    return and_ask_again(real().cuCtxPopCurrent_v2(context));
}

CUresult CUDAAPI cuCtxCreate(CUcontext* context, unsigned flags, CUdevice device) {
    return and_ask_again(real().cuCtxCreate_v1(context, flags, device));
}

CUresult CUDAAPI cuCtxCreate_v2(CUcontext* context, unsigned flags, CUdevice device) {
    return and_ask_again(real().cuCtxCreate_v2(context, flags, device));
}

CUresult CUDAAPI cuCtxCreate_v3(CUcontext* context, CUexecAffinityParam* affinity, int num_affinity,
                                unsigned flags, CUdevice device) {
    return and_ask_again(real().cuCtxCreate_v3(context, affinity, num_affinity, flags, device));
}

CUresult CUDAAPI cuCtxCreate_v4(CUcontext* context, CUctxCreateParams* parameters, unsigned flags,
                                CUdevice device) {
    return and_ask_again(real().cuCtxCreate_v4(context, parameters, flags, device));
}

}  // extern "C"
