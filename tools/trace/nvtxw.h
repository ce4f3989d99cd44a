// SPDX-License-Identifier: Apache-2.0
//
// NVTXW, the NVTX Writer interface, version 2: how a tool's library (a backend) takes events that
// have happened already. No toolkit has its header (nvtxw3/nvtxw3.h of NVIDIA's NVTX), so what we
// use of it is declared here. Its payloads, counters and strings are those of NVTX's extensions.
//
// The backend is a shared library with one entry, nvtxwGetInterface. It answers with a table of
// functions, which return 0 or what went wrong. A later minor version fills slots at the table's
// end; a function that a backend does not have is null.
#pragma once

#include <nvtx3/nvToolsExtCounters.h>
#include <nvtx3/nvToolsExtPayload.h>

#include <cstddef>
#include <cstdint>
#include <string>

namespace urgengo::trace::nvtxw {

inline constexpr std::int32_t kVersion = 2;
inline constexpr const char* kEntry = "nvtxwGetInterface";
inline constexpr const char* kEntryOfVersion1 = "nvtxwLoadImplementation";
/// Names the library for every program that writes.
inline constexpr const char* kLibraryVariable = "NVTXW3_LIBRARY";
inline constexpr const char* kLibrary = "libnvtxw3.so";

using Code = std::int32_t;  ///< 0: it worked
inline constexpr Code kSuccess = 0;
/// @returns "invalid argument", ..., "code 23"
std::string code_words(Code code);

using Session = void*;
using Stream = void*;

// Each begins with its own size, by which a backend knows what is there.
struct SessionAttributes {
    std::size_t size = sizeof(SessionAttributes);
    const char* name = nullptr;    ///< of the session; a backend may name a file by it
    const char* config = nullptr;  ///< "key=value" lines for the backend; may be null
};
struct DomainAttributes {
    std::size_t size = sizeof(DomainAttributes);
    const char* name = nullptr;
};
/// In which order a stream's events come, by their times.
enum class Order : std::int16_t { kUnknown = 0, kByBegin = 2, kByEnd = 3 };
struct StreamAttributes {
    std::size_t size = sizeof(StreamAttributes);
    const char* name = nullptr;  ///< the only one of its session
    nvtxDomainHandle_t domain = nullptr;
    std::uint64_t scope = NVTX_SCOPE_NONE;
    std::uint64_t time_domain = NVTX_TIMESTAMP_TYPE_NONE;  ///< of all its times
    std::int16_t interleaving = 0;  ///< the order holds for all of the stream
    Order order = Order::kUnknown;
    std::int32_t skid = 0;  ///< none: no event comes later than its order says
    std::int64_t skid_amount = 0;
};

struct Interface {
    Code (*session_begin)(const SessionAttributes*, Session* made);
    /// All has been written: what becomes of it is the backend's.
    Code (*session_end)(Session);
    Code (*domain_register)(Session, const DomainAttributes*, nvtxDomainHandle_t* made);
    Code (*category_register)(nvtxDomainHandle_t, std::uint32_t category, const char* name);
    Code (*string_register)(nvtxDomainHandle_t, const char* text, nvtxStringHandle_t* made);
    void (*resource_register)();
    void (*scope_register)();
    Code (*schema_register)(nvtxDomainHandle_t, const nvtxPayloadSchemaAttr_t*,
                            std::uint64_t* made);
    void (*enum_register)();
    Code (*counter_register)(nvtxDomainHandle_t, const nvtxCounterAttr_t*, std::uint64_t* made);
    void (*time_domain_register)();
    Code (*stream_open)(Session, const StreamAttributes*, Stream* made);
    Code (*stream_close)(Stream);
    /// One event.
    Code (*event_write)(Stream, const nvtxPayloadData_t*, std::size_t count);
    void (*event_batch_write)();
    Code (*counter_write)(Stream, std::int64_t time, std::uint64_t counter, const void* value,
                          std::size_t bytes);
    void (*counter_no_value_write)();
    void (*counter_batch_write)();
    /// The two times, each of its domain, are the same.
    Code (*time_sync_point_write)(Stream, std::uint64_t domain1, std::uint64_t domain2,
                                  std::int64_t time1, std::int64_t time2);
    void (*time_sync_point_table_write)();
    void (*timestamp_conversion_factor_write)();
    void (*reserved[43])();
};
static_assert(sizeof(Interface) == 64 * sizeof(void*));

using GetInterface = Code (*)(std::int32_t version, const void** made);

}  // namespace urgengo::trace::nvtxw
