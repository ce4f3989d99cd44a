// SPDX-License-Identifier: Apache-2.0
//
// Linear asynchronous copies. If the config asks for it (`copies:`), those of tasks wait for more
// urgent ones and large ones are made in slices: the program's call, then, is several calls of the
// same function on the same stream, whose first error is its result (runtime/copies.cpp). Otherwise
// they are only forwarded.
#include <algorithm>

#include "interposer/boundary.h"
#include "interposer/own_time.h"
#include "interposer/real_driver.h"

using namespace urgengo::interposer;
using urgengo::exec::StreamFlavor;
using urgengo::runtime::Copy;
using urgengo::runtime::CopyTurn;
using urgengo::runtime::ThreadState;

namespace {

/// The thread has its task's turn to copy for as long as the object lives (a cancelled one, too).
class Turn {
  public:
    explicit Turn(const Copy& copy) : copy_(copy) {
        protect([&] {
            thread_ = this_thread();
            if (thread_) turn_ = the_runtime().copies().begin(*thread_, copy_);
        });
    }
    ~Turn() {
        if (turn_.task) protect([&] { urgengo::runtime::Copies::end(turn_); });
    }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;

    /// @returns how much is copied next, of so much
    std::size_t slice(std::size_t left) const {
        return turn_.slice > 0 ? std::min(turn_.slice, left) : left;
    }
    void before_slice() {
        if (acts()) protect([&] { the_runtime().copies().before_slice(*thread_, copy_, turn_); });
    }
    void after_slice(std::size_t bytes) {
        if (acts())
            protect([&] { the_runtime().copies().after_slice(*thread_, copy_, turn_, bytes); });
    }

  private:
    bool acts() const { return turn_.task && is_armed(); }

    const Copy& copy_;
    ThreadState* thread_ = nullptr;
    CopyTurn turn_;
};

/// @param call  (std::size_t offset, std::size_t bytes) -> CUresult: that part of the program's own
template <typename Call>
[[gnu::noinline]] CUresult copying(const Copy& copy, Call&& call) {
    if (!acts_already()) return call(std::size_t{0}, copy.bytes);
    const Inside inside;
    Turn turn(copy);
    std::size_t done = 0;
    do {
        const std::size_t bytes = turn.slice(copy.bytes - done);
        turn.before_slice();
        const CUresult result = call(done, bytes);
        if (result != CUDA_SUCCESS) return result;
        turn.after_slice(bytes);
        done += bytes;
    } while (done < copy.bytes);
    return CUDA_SUCCESS;
}

CUdeviceptr address_of(const void* on_host) {
    return reinterpret_cast<CUdeviceptr>(on_host);
}
const void* moved(const void* pointer, std::size_t bytes) {
    return static_cast<const char*>(pointer) + bytes;
}
void* moved(void* pointer, std::size_t bytes) {
    return static_cast<char*>(pointer) + bytes;
}

// An asynchronous copy into memory that is not page-locked waits, in the driver, for what is before
// it on its stream (PyTorch's way to its results). Not taken for a wait of the program's, only
// slept through if the config asks for that.
void sleep_before_copy(void* h_destination, CUstream stream, StreamFlavor flavor) {
    if (!acts_already() || !t_this.state || !the_runtime().waits().are_slept_through()) return;
    const OwnTime own_time(CallClass::kCopy);
    const Inside inside;
    protect([&] {
        unsigned type = 0;
        if (real().cuPointerGetAttribute(&type, CU_POINTER_ATTRIBUTE_MEMORY_TYPE,
                                         address_of(h_destination)) == CUDA_SUCCESS)
            return;
        urgengo::runtime::Wait wait;
        wait.function = urgengo::abi::TraceWait::kCopy;
        wait.stream = stream;
        wait.flavor = flavor;
        the_runtime().waits().before(*t_this.state, wait);
        the_runtime().waits().sleep_through(*t_this.state, wait);
        the_runtime().waits().wait_is_left(*t_this.state);
    });
}

}  // namespace

// These names stand for others in cuda.h.
#undef cuMemcpyAsync
#undef cuMemcpyDtoDAsync_v2
#undef cuMemcpyDtoHAsync_v2
#undef cuMemcpyHtoDAsync_v2

extern "C" {

CUresult CUDAAPI cuMemcpyHtoDAsync_v2(CUdeviceptr to, const void* h_from, size_t bytes,
                                      CUstream stream) {
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyHtoDAsync_v2(to, h_from, bytes, stream);
    return copying({to, address_of(h_from), bytes, stream, StreamFlavor::kLegacy},
                   [&](size_t at, size_t part) {
                       return real().cuMemcpyHtoDAsync_v2(to + at, moved(h_from, at), part, stream);
                   });
}

CUresult CUDAAPI cuMemcpyHtoDAsync_v2_ptsz(CUdeviceptr to, const void* h_from, size_t bytes,
                                           CUstream stream) {
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyHtoDAsync_v2_ptsz(to, h_from, bytes, stream);
    return copying({to, address_of(h_from), bytes, stream, StreamFlavor::kPerThread},
                   [&](size_t at, size_t part) {
                       return real().cuMemcpyHtoDAsync_v2_ptsz(to + at, moved(h_from, at), part,
                                                               stream);
                   });
}

CUresult CUDAAPI cuMemcpyDtoHAsync_v2(void* h_to, CUdeviceptr from, size_t bytes, CUstream stream) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuMemcpyDtoHAsync_v2(h_to, from, bytes, stream);
    sleep_before_copy(h_to, stream, StreamFlavor::kLegacy);
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyDtoHAsync_v2(h_to, from, bytes, stream);
    return copying({address_of(h_to), from, bytes, stream, StreamFlavor::kLegacy},
                   [&](size_t at, size_t part) {
                       return real().cuMemcpyDtoHAsync_v2(moved(h_to, at), from + at, part, stream);
                   });
}

CUresult CUDAAPI cuMemcpyDtoHAsync_v2_ptsz(void* h_to, CUdeviceptr from, size_t bytes,
                                           CUstream stream) {
    if (const auto* driver = real_if_bystanders_event())
        return driver->cuMemcpyDtoHAsync_v2_ptsz(h_to, from, bytes, stream);
    sleep_before_copy(h_to, stream, StreamFlavor::kPerThread);
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyDtoHAsync_v2_ptsz(h_to, from, bytes, stream);
    return copying({address_of(h_to), from, bytes, stream, StreamFlavor::kPerThread},
                   [&](size_t at, size_t part) {
                       return real().cuMemcpyDtoHAsync_v2_ptsz(moved(h_to, at), from + at, part,
                                                               stream);
                   });
}

CUresult CUDAAPI cuMemcpyDtoDAsync_v2(CUdeviceptr to, CUdeviceptr from, size_t bytes,
                                      CUstream stream) {
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyDtoDAsync_v2(to, from, bytes, stream);
    return copying({to, from, bytes, stream, StreamFlavor::kLegacy}, [&](size_t at, size_t part) {
        return real().cuMemcpyDtoDAsync_v2(to + at, from + at, part, stream);
    });
}

CUresult CUDAAPI cuMemcpyDtoDAsync_v2_ptsz(CUdeviceptr to, CUdeviceptr from, size_t bytes,
                                           CUstream stream) {
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyDtoDAsync_v2_ptsz(to, from, bytes, stream);
    return copying({to, from, bytes, stream, StreamFlavor::kPerThread},
                   [&](size_t at, size_t part) {
                       return real().cuMemcpyDtoDAsync_v2_ptsz(to + at, from + at, part, stream);
                   });
}

CUresult CUDAAPI cuMemcpyAsync(CUdeviceptr to, CUdeviceptr from, size_t bytes, CUstream stream) {
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyAsync(to, from, bytes, stream);
    return copying({to, from, bytes, stream, StreamFlavor::kLegacy}, [&](size_t at, size_t part) {
        return real().cuMemcpyAsync(to + at, from + at, part, stream);
    });
}

CUresult CUDAAPI cuMemcpyAsync_ptsz(CUdeviceptr to, CUdeviceptr from, size_t bytes,
                                    CUstream stream) {
    if (const auto* driver = real_if_copies_pass())
        return driver->cuMemcpyAsync_ptsz(to, from, bytes, stream);
    return copying({to, from, bytes, stream, StreamFlavor::kPerThread},
                   [&](size_t at, size_t part) {
                       return real().cuMemcpyAsync_ptsz(to + at, from + at, part, stream);
                   });
}

}  // extern "C"
