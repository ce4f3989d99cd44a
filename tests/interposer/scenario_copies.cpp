// SPDX-License-Identifier: Apache-2.0
//
// Every copy and every memset keeps its place between launches, on every kind of stream: it finds
// what the launch before it wrote, and not what the launch after it writes. Entries that a driver
// does not have are said to be missing.
#include <algorithm>
#include <array>
#include <functional>
#include <vector>

#include "tests/interposer/gpu.h"
#include "tests/interposer/twin.h"

namespace twin {
namespace {

constexpr std::size_t kBytes = 64;
constexpr std::size_t kPitch = 16;  // the same bytes as rows
constexpr std::size_t kRows = kBytes / kPitch;

/// @returns null if the driver does not have it
template <typename Function>
Function* find(const char* name, int version) {
    void* function = nullptr;
    CUdriverProcAddressQueryResult status;
    const CUresult result = cuGetProcAddress(name, &function, version, 0, &status);
    return result == CUDA_SUCCESS ? reinterpret_cast<Function*>(function) : nullptr;
}

/// What is copied, and where to: one word is enough to see order by.
struct Place {
    std::uint64_t* mapped = make_mapped(kBytes / sizeof(std::uint64_t));
    CUdeviceptr memory = 0;
    CUarray array = nullptr;

    Place() {
        MUST(cuMemAlloc(&memory, kBytes));
        using Create = CUresult(CUarray*, const CUDA_ARRAY_DESCRIPTOR*);
        const CUDA_ARRAY_DESCRIPTOR shape{kBytes, 0, CU_AD_FORMAT_UNSIGNED_INT8, 1};
        if (auto* const create = find<Create>("cuArrayCreate", 3020)) MUST(create(&array, &shape));
    }
    CUdeviceptr host() const { return on_gpu(mapped); }
};

struct Copies {
    Gpu gpu;
    CUfunction mix = gpu.function(kMixName);
    Place from, to;

    CUresult launch_mix(CUdeviceptr word, std::uint64_t value, CUstream stream) const {
        void* parameters[] = {&word, &value};
        return cuLaunchKernel(mix, 1, 1, 1, 1, 1, 1, 0, stream, parameters, nullptr);
    }
};

/// A copy or memset of kBytes.
struct Variant {
    const char* name;
    CUdeviceptr from, to;  ///< as kernels see them; from is 0 for memsets
    std::function<CUresult(CUstream)> call;
};

void check(const Copies& copies, const Variant& variant, const char* stream_name, CUstream stream) {
    for (CUdeviceptr address : {variant.from, variant.to})
        if (address) MUST(cuMemsetD8(address, 0, kBytes));
    MUST(cuCtxSynchronize());
    MUST(launch_wide(copies.gpu.wide, stream));
    MUST(copies.launch_mix(variant.from ? variant.from : variant.to, 1, stream));
    errno = kErrno;
    const CUresult result = variant.call(stream);
    const int errno_after = errno;
    if (variant.from) MUST(copies.launch_mix(variant.from, 2, stream));
    MUST(launch_wide(copies.gpu.wide, stream));
    MUST(copies.launch_mix(variant.to, 3, stream));
    MUST(cuStreamSynchronize(stream));
    std::array<std::uint64_t, kBytes / sizeof(std::uint64_t)> found{};
    MUST(cuMemcpyDtoH(found.data(), variant.to, kBytes));
    say("%s on the %s stream: %d, errno %d, %llx %llx", variant.name, stream_name, result,
        errno_after, static_cast<unsigned long long>(found.front()),
        static_cast<unsigned long long>(found.back()));
}

void check_on_streams(const Copies& copies, const std::vector<Variant>& variants) {
    const std::pair<const char*, CUstream> streams[] = {
        {"legacy", nullptr},
        {"per-thread", CU_STREAM_PER_THREAD},
        {"blocking", make_stream(CU_STREAM_DEFAULT)},
        {"non-blocking", make_stream(CU_STREAM_NON_BLOCKING, -1)}};
    for (const auto& [name, stream] : streams)
        for (const Variant& variant : variants) check(copies, variant, name, stream);
}

/// Synchronous ones are on the legacy stream, which waits for the other blocking ones.
void check_synchronous(const Copies& copies, const std::vector<Variant>& variants) {
    const CUstream blocking = make_stream(CU_STREAM_DEFAULT);
    for (const Variant& variant : variants) {
        check(copies, variant, "legacy", nullptr);
        check(copies, variant, "blocking", blocking);
    }
}

/// Adds a variant whose entry point the driver may lack.
template <typename Function, typename Call>
void add_if_there(std::vector<Variant>& variants, const char* name, int version, CUdeviceptr from,
                  CUdeviceptr to, Call call) {
    if (Function* const function = find<Function>(name, version))
        variants.push_back(
            {name, from, to, [function, call](CUstream stream) { return call(function, stream); }});
    else
        say("%s: missing", name);
}

int linear_copies(const Arguments&) {
    const Copies copies;
    const CUdeviceptr d_from = copies.from.memory, d_to = copies.to.memory,
                      h_from = copies.from.host(), h_to = copies.to.host();
    void* const host_from = copies.from.mapped;
    void* const host_to = copies.to.mapped;
    const CUcontext context = copies.gpu.context;
    std::vector<Variant> variants = {
        {"cuMemcpyAsync", d_from, d_to,
         [=](CUstream s) { return cuMemcpyAsync(d_to, d_from, kBytes, s); }},
        {"cuMemcpyAsync from the host", h_from, d_to,
         [=](CUstream s) { return cuMemcpyAsync(d_to, h_from, kBytes, s); }},
        {"cuMemcpyAsync to the host", d_from, h_to,
         [=](CUstream s) { return cuMemcpyAsync(h_to, d_from, kBytes, s); }},
        {"cuMemcpyHtoDAsync", h_from, d_to,
         [=](CUstream s) { return cuMemcpyHtoDAsync(d_to, host_from, kBytes, s); }},
        {"cuMemcpyDtoHAsync", d_from, h_to,
         [=](CUstream s) { return cuMemcpyDtoHAsync(host_to, d_from, kBytes, s); }},
        {"cuMemcpyDtoDAsync", d_from, d_to,
         [=](CUstream s) { return cuMemcpyDtoDAsync(d_to, d_from, kBytes, s); }},
        {"cuMemsetD8Async", 0, d_to,
         [=](CUstream s) { return cuMemsetD8Async(d_to, 5, kBytes, s); }},
        {"cuMemsetD16Async", 0, d_to,
         [=](CUstream s) { return cuMemsetD16Async(d_to, 6, kBytes / 2, s); }},
        {"cuMemsetD32Async", 0, d_to,
         [=](CUstream s) { return cuMemsetD32Async(d_to, 7, kBytes / 4, s); }}};
    using PeerAsync =
        CUresult(CUdeviceptr, CUcontext, CUdeviceptr, CUcontext, std::size_t, CUstream);
    add_if_there<PeerAsync>(variants, "cuMemcpyPeerAsync", 4000, d_from, d_to,
                            [=](PeerAsync* copy, CUstream s) {
                                return copy(d_to, context, d_from, context, kBytes, s);
                            });
    check_on_streams(copies, variants);

    variants = {
        {"cuMemcpy", d_from, d_to, [=](CUstream) { return cuMemcpy(d_to, d_from, kBytes); }},
        {"cuMemcpyHtoD", h_from, d_to,
         [=](CUstream) { return cuMemcpyHtoD(d_to, host_from, kBytes); }},
        {"cuMemcpyDtoH", d_from, h_to,
         [=](CUstream) { return cuMemcpyDtoH(host_to, d_from, kBytes); }},
        {"cuMemcpyDtoD", d_from, d_to,
         [=](CUstream) { return cuMemcpyDtoD(d_to, d_from, kBytes); }},
        {"cuMemsetD8", 0, d_to, [=](CUstream) { return cuMemsetD8(d_to, 5, kBytes); }},
        {"cuMemsetD16", 0, d_to, [=](CUstream) { return cuMemsetD16(d_to, 6, kBytes / 2); }},
        {"cuMemsetD32", 0, d_to, [=](CUstream) { return cuMemsetD32(d_to, 7, kBytes / 4); }}};
    using Peer = CUresult(CUdeviceptr, CUcontext, CUdeviceptr, CUcontext, std::size_t);
    add_if_there<Peer>(variants, "cuMemcpyPeer", 4000, d_from, d_to, [=](Peer* copy, CUstream) {
        return copy(d_to, context, d_from, context, kBytes);
    });
    check_synchronous(copies, variants);
    return 0;
}

CUDA_MEMCPY2D rows(CUdeviceptr from, CUdeviceptr to) {
    CUDA_MEMCPY2D shape{};
    shape.srcMemoryType = shape.dstMemoryType = CU_MEMORYTYPE_UNIFIED;
    shape.srcDevice = from;
    shape.dstDevice = to;
    shape.srcPitch = shape.dstPitch = shape.WidthInBytes = kPitch;
    shape.Height = kRows;
    return shape;
}

CUDA_MEMCPY3D box(CUdeviceptr from, CUdeviceptr to) {
    CUDA_MEMCPY3D shape{};
    shape.srcMemoryType = shape.dstMemoryType = CU_MEMORYTYPE_UNIFIED;
    shape.srcDevice = from;
    shape.dstDevice = to;
    shape.srcPitch = shape.dstPitch = shape.WidthInBytes = kPitch;
    shape.srcHeight = shape.dstHeight = shape.Height = kRows / 2;
    shape.Depth = 2;
    return shape;
}

CUDA_MEMCPY3D_PEER box_of_peers(CUdeviceptr from, CUdeviceptr to, CUcontext context) {
    CUDA_MEMCPY3D_PEER shape{};
    shape.srcMemoryType = shape.dstMemoryType = CU_MEMORYTYPE_DEVICE;
    shape.srcDevice = from;
    shape.dstDevice = to;
    shape.srcContext = shape.dstContext = context;
    shape.srcPitch = shape.dstPitch = shape.WidthInBytes = kPitch;
    shape.srcHeight = shape.dstHeight = shape.Height = kRows / 2;
    shape.Depth = 2;
    return shape;
}

int shaped_copies(const Arguments&) {
    const Copies copies;
    const CUdeviceptr d_from = copies.from.memory, d_to = copies.to.memory,
                      h_from = copies.from.host(), h_to = copies.to.host();
    const CUcontext context = copies.gpu.context;
    std::vector<Variant> variants;
    using Rows = CUresult(const CUDA_MEMCPY2D*, CUstream);
    for (const auto& [from, to] : {std::pair{d_from, d_to}, {h_from, d_to}, {d_from, h_to}})
        add_if_there<Rows>(
            variants, "cuMemcpy2DAsync", 3020, from, to,
            [shape = rows(from, to)](Rows* copy, CUstream s) { return copy(&shape, s); });
    using Box = CUresult(const CUDA_MEMCPY3D*, CUstream);
    add_if_there<Box>(
        variants, "cuMemcpy3DAsync", 3020, d_from, d_to,
        [shape = box(d_from, d_to)](Box* copy, CUstream s) { return copy(&shape, s); });
    using BoxOfPeers = CUresult(const CUDA_MEMCPY3D_PEER*, CUstream);
    add_if_there<BoxOfPeers>(variants, "cuMemcpy3DPeerAsync", 4000, d_from, d_to,
                             [shape = box_of_peers(d_from, d_to, context)](
                                 BoxOfPeers* copy, CUstream s) { return copy(&shape, s); });
    using Set8 =
        CUresult(CUdeviceptr, std::size_t, unsigned char, std::size_t, std::size_t, CUstream);
    add_if_there<Set8>(variants, "cuMemsetD2D8Async", 3020, 0, d_to, [=](Set8* set, CUstream s) {
        return set(d_to, kPitch, 5, kPitch, kRows, s);
    });
    using Set16 =
        CUresult(CUdeviceptr, std::size_t, unsigned short, std::size_t, std::size_t, CUstream);
    add_if_there<Set16>(variants, "cuMemsetD2D16Async", 3020, 0, d_to, [=](Set16* set, CUstream s) {
        return set(d_to, kPitch, 6, kPitch / 2, kRows, s);
    });
    using Set32 = CUresult(CUdeviceptr, std::size_t, unsigned, std::size_t, std::size_t, CUstream);
    add_if_there<Set32>(variants, "cuMemsetD2D32Async", 3020, 0, d_to, [=](Set32* set, CUstream s) {
        return set(d_to, kPitch, 7, kPitch / 4, kRows, s);
    });
    check_on_streams(copies, variants);

    variants.clear();
    using RowsNow = CUresult(const CUDA_MEMCPY2D*);
    for (const char* name : {"cuMemcpy2D", "cuMemcpy2DUnaligned"})
        add_if_there<RowsNow>(
            variants, name, 3020, d_from, d_to,
            [shape = rows(d_from, d_to)](RowsNow* copy, CUstream) { return copy(&shape); });
    using BoxNow = CUresult(const CUDA_MEMCPY3D*);
    add_if_there<BoxNow>(
        variants, "cuMemcpy3D", 3020, d_from, d_to,
        [shape = box(d_from, d_to)](BoxNow* copy, CUstream) { return copy(&shape); });
    using BoxOfPeersNow = CUresult(const CUDA_MEMCPY3D_PEER*);
    add_if_there<BoxOfPeersNow>(variants, "cuMemcpy3DPeer", 4000, d_from, d_to,
                                [shape = box_of_peers(d_from, d_to, context)](
                                    BoxOfPeersNow* copy, CUstream) { return copy(&shape); });
    using Set32Now = CUresult(CUdeviceptr, std::size_t, unsigned, std::size_t, std::size_t);
    add_if_there<Set32Now>(variants, "cuMemsetD2D32", 3020, 0, d_to, [=](Set32Now* set, CUstream) {
        return set(d_to, kPitch, 7, kPitch / 4, kRows);
    });
    check_synchronous(copies, variants);
    return 0;
}

// Through an array, which kernels cannot write here: in and out again.
int array_copies(const Arguments&) {
    const Copies copies;
    const CUdeviceptr d_from = copies.from.memory, d_to = copies.to.memory,
                      h_from = copies.from.host(), h_to = copies.to.host();
    void* const host_from = copies.from.mapped;
    void* const host_to = copies.to.mapped;
    const CUarray first = copies.from.array, second = copies.to.array;
    using In = CUresult(CUarray, std::size_t, const void*, std::size_t);
    using Out = CUresult(void*, CUarray, std::size_t, std::size_t);
    using InAsync = CUresult(CUarray, std::size_t, const void*, std::size_t, CUstream);
    using OutAsync = CUresult(void*, CUarray, std::size_t, std::size_t, CUstream);
    using FromMemory = CUresult(CUarray, std::size_t, CUdeviceptr, std::size_t);
    using ToMemory = CUresult(CUdeviceptr, CUarray, std::size_t, std::size_t);
    using Across = CUresult(CUarray, std::size_t, CUarray, std::size_t, std::size_t);
    std::vector<Variant> variants;
    if (auto* const out = find<OutAsync>("cuMemcpyAtoHAsync", 3020))
        add_if_there<InAsync>(variants, "cuMemcpyHtoAAsync", 3020, h_from, h_to,
                              [=](InAsync* in, CUstream s) {
                                  const CUresult result = in(first, 0, host_from, kBytes, s);
                                  return result ? result : out(host_to, first, 0, kBytes, s);
                              });
    check_on_streams(copies, variants);
    variants.clear();
    if (auto* const out = find<Out>("cuMemcpyAtoH", 3020))
        add_if_there<In>(variants, "cuMemcpyHtoA", 3020, h_from, h_to, [=](In* in, CUstream) {
            const CUresult result = in(first, 0, host_from, kBytes);
            return result ? result : out(host_to, first, 0, kBytes);
        });
    auto* const out = find<ToMemory>("cuMemcpyAtoD", 3020);
    auto* const across = find<Across>("cuMemcpyAtoA", 3020);
    if (out && across)
        add_if_there<FromMemory>(variants, "cuMemcpyDtoA", 3020, d_from, d_to,
                                 [=](FromMemory* in, CUstream) {
                                     CUresult result = in(first, 0, d_from, kBytes);
                                     if (!result) result = across(second, 0, first, 0, kBytes);
                                     return result ? result : out(d_to, second, 0, kBytes);
                                 });
    check_synchronous(copies, variants);
    return 0;
}

#if CUDA_VERSION >= 12080
// Several copies in one call, in both of its signatures.
int batch_copies(const Arguments&) {
    const Copies copies;
    const CUdeviceptr d_from = copies.from.memory, d_to = copies.to.memory;
    std::array<CUdeviceptr, 2> to{d_to, d_to + kBytes / 2}, from{d_from, d_from + kBytes / 2};
    std::array<std::size_t, 2> sizes{kBytes / 2, kBytes / 2};
    CUmemcpyAttributes attributes{};
    attributes.srcAccessOrder = CU_MEMCPY_SRC_ACCESS_ORDER_STREAM;
    std::size_t first = 0;
    using Old = CUresult(CUdeviceptr*, CUdeviceptr*, std::size_t*, std::size_t, CUmemcpyAttributes*,
                         std::size_t*, std::size_t, std::size_t*, CUstream);
    using New = CUresult(CUdeviceptr*, CUdeviceptr*, std::size_t*, std::size_t, CUmemcpyAttributes*,
                         std::size_t*, std::size_t, CUstream);
    const auto check_on = [&](const char* name, CUstream stream) {
        std::vector<Variant> variants;
        add_if_there<Old>(variants, "cuMemcpyBatchAsync", 12080, d_from, d_to,
                          [&](Old* copy, CUstream s) {
                              std::size_t failed = 99;
                              return copy(to.data(), from.data(), sizes.data(), 2, &attributes,
                                          &first, 1, &failed, s);
                          });
        add_if_there<New>(
            variants, "cuMemcpyBatchAsync", 13000, d_from, d_to, [&](New* copy, CUstream s) {
                return copy(to.data(), from.data(), sizes.data(), 2, &attributes, &first, 1, s);
            });
        for (const Variant& variant : variants) check(copies, variant, name, stream);
    };
    check_on("blocking", make_stream(CU_STREAM_DEFAULT));
    check_on("non-blocking", make_stream());
    check_on("legacy", nullptr);  // which such a copy refuses
    return 0;
}
const Scenario s1("batch_copies", batch_copies);
#endif

const Scenario s2("linear_copies", linear_copies), s3("shaped_copies", shaped_copies),
    s4("array_copies", array_copies);

}  // namespace
}  // namespace twin
