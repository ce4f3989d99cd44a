// SPDX-License-Identifier: Apache-2.0
//
// What the program asks of a stream's priority, and sets: its own value, while UrgenGo has lent the
// stream another one for a launch (exec/stream_priorities.h).
#include "interposer/boundary.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;

namespace {

template <typename Call, typename Lent>
CUresult asking_priority(CUstream stream, StreamFlavor flavor, Call&& call, Lent&& lent) {
    if (!acts_already()) return call();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    // Not in protect(): the call is the program's own, made exactly once.
    return the_runtime().streams().priorities().ask(
        stream, flavor, [&] { return OwnTime::in_driver(call); }, lent);
}

CUresult get_priority(CUstream stream, int* priority, StreamFlavor flavor) {
    return asking_priority(
        stream, flavor,
        [&] {
            return flavor == StreamFlavor::kPerThread
                       ? real().cuStreamGetPriority_ptsz(stream, priority)
                       : real().cuStreamGetPriority(stream, priority);
        },
        [&](int own) { *priority = own; });
}

CUresult get_attribute(CUstream stream, CUstreamAttrID id, CUstreamAttrValue* value,
                       StreamFlavor flavor) {
    const auto get = [&] {
        return flavor == StreamFlavor::kPerThread
                   ? real().cuStreamGetAttribute_ptsz(stream, id, value)
                   : real().cuStreamGetAttribute(stream, id, value);
    };
    if (id != CU_LAUNCH_ATTRIBUTE_PRIORITY) return get();
    return asking_priority(stream, flavor, get, [&](int own) { value->priority = own; });
}

template <typename Call>
CUresult setting_priority(CUstream stream, CUstream from, StreamFlavor flavor, Call&& call) {
    if (!acts_already()) return call();
    const OwnTime own_time(CallClass::kOther);
    const Inside inside;
    return the_runtime().streams().priorities().set_by_program(
        stream, from, flavor, [&] { return OwnTime::in_driver(call); });
}

CUresult set_attribute(CUstream stream, CUstreamAttrID id, const CUstreamAttrValue* value,
                       StreamFlavor flavor) {
    const auto set = [&] {
        return flavor == StreamFlavor::kPerThread
                   ? real().cuStreamSetAttribute_ptsz(stream, id, value)
                   : real().cuStreamSetAttribute(stream, id, value);
    };
    if (id != CU_LAUNCH_ATTRIBUTE_PRIORITY) return set();
    return setting_priority(stream, stream, flavor, set);
}

CUresult copy_attributes(CUstream to, CUstream from, StreamFlavor flavor) {
    return setting_priority(to, from, flavor, [&] {
        return flavor == StreamFlavor::kPerThread ? real().cuStreamCopyAttributes_ptsz(to, from)
                                                  : real().cuStreamCopyAttributes(to, from);
    });
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuStreamCopyAttributes
#undef cuStreamGetAttribute
#undef cuStreamGetPriority
#undef cuStreamSetAttribute

extern "C" {

CUresult CUDAAPI cuStreamGetPriority(CUstream stream, int* priority) {
    return get_priority(stream, priority, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuStreamGetPriority_ptsz(CUstream stream, int* priority) {
    return get_priority(stream, priority, StreamFlavor::kPerThread);
}

CUresult CUDAAPI cuStreamGetAttribute(CUstream stream, CUstreamAttrID id,
                                      CUstreamAttrValue* value) {
    return get_attribute(stream, id, value, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuStreamGetAttribute_ptsz(CUstream stream, CUstreamAttrID id,
                                           CUstreamAttrValue* value) {
    return get_attribute(stream, id, value, StreamFlavor::kPerThread);
}

CUresult CUDAAPI cuStreamSetAttribute(CUstream stream, CUstreamAttrID id,
                                      const CUstreamAttrValue* value) {
    return set_attribute(stream, id, value, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuStreamSetAttribute_ptsz(CUstream stream, CUstreamAttrID id,
                                           const CUstreamAttrValue* value) {
    return set_attribute(stream, id, value, StreamFlavor::kPerThread);
}

CUresult CUDAAPI cuStreamCopyAttributes(CUstream to, CUstream from) {
    return copy_attributes(to, from, StreamFlavor::kLegacy);
}

CUresult CUDAAPI cuStreamCopyAttributes_ptsz(CUstream to, CUstream from) {
    return copy_attributes(to, from, StreamFlavor::kPerThread);
}

}  // extern "C"
