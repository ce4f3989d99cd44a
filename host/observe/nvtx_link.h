// SPDX-License-Identifier: Apache-2.0
//
// Our side of NVTX towards another tool: tables of our own, which the tool fills as those of any
// program, and calls of what it has put in. NVTX's own implementation is not used: it would look
// for its tool in the environment, and find us there.
//
// What the tool does not offer is left out, or said in a plainer way: without the payload
// extension, or without registered strings, as text in the event's message; without counters as
// marks with a number.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "host/observe/nvtx_table.h"

namespace urgengo::observe {

/// What an injection library exports, each null if it does not.
struct NvtxInjection {
    /// InitializeInjectionNvtx2
    int (*initialize)(const void* (*tables)(std::uint32_t)) = nullptr;
    /// InitializeInjectionNvtxExtension
    int (*initialize_extension)(void* module) = nullptr;
};

struct NvtxSlots;

class NvtxLink {
  public:
    /// A string, and the tool's handle of it.
    struct Text {
        std::string text;
        std::uint64_t handle = 0;  ///< 0: the tool keeps none
    };
    /// Of an entry of a schema.
    struct Value {
        Value(std::int64_t its_number) : number(its_number) {}  // NOLINT: as it is in the schema
        Value(const Text* its_text) : text(its_text) {}         // NOLINT
        const Text* text = nullptr;                             ///< null: none, or a number
        std::int64_t number = 0;
    };
    using Values = std::span<const Value>;

    /// @returns null if the tool refuses. A second link makes the first one useless.
    static std::unique_ptr<NvtxLink> attach(const NvtxInjection& tool);
    /// @returns the newest one that is there; null: none. @threads any
    static const NvtxLink* of_process();
    ~NvtxLink();
    NvtxLink(const NvtxLink&) = delete;
    NvtxLink& operator=(const NvtxLink&) = delete;

    /// Before others use the link: where it stays. @threads one
    const Text* add_text(std::string_view text);
    std::uint64_t add_counter(const std::string& name, const nvtx::CounterInfo& info);

    // --- @threads any; takes no lock. The tool may open and write files: no cancellation points
    const Text* word(nvtx::Word word) const { return words_[static_cast<std::size_t>(word)]; }

    /// @returns the range, for end(); 0 if there is none
    std::uint64_t start(nvtx::Category category, const Text* name, nvtx::Schema schema,
                        Values values) const;
    void end(std::uint64_t range, nvtx::Schema schema, Values values) const;
    void mark(nvtx::Category category, const Text* name, nvtx::Schema schema, Values values) const;

    /// Whether what the GPU has done can be told afterwards, on its own clock.
    bool takes_deferred() const { return gpu_time_ != 0; }
    void event(Values gpu) const;
    /// A time of the GPU's clock, and of CLOCK_MONOTONIC, each ns.
    struct SyncPoint {
        std::int64_t gpu = 0, host = 0;
    };
    /// @param points  two or more, in order
    void sync(std::span<const SyncPoint> points) const;

    /// @param counter  of add_counter()
    void sample(std::uint64_t counter, const Text* name, std::int64_t value) const;

    void name_thread(std::uint32_t id, const char* name) const;
    void name_stream(void* stream, const char* name) const;

  private:
    NvtxLink() = default;

    void register_all();
    void register_time();
    void register_schema(nvtx::Schema schema);
    std::uint64_t id_of(nvtx::Schema schema) const {
        return schemas_[static_cast<std::size_t>(schema)];
    }
    template <typename Use>
    auto with_event(nvtx::Category category, const Text* name, nvtx::Schema schema, Values values,
                    Use&& use) const;

    NvtxSlots* slots_ = nullptr;  // lives on
    void* domain_ = nullptr;      // the default one, if the tool has no others
    bool keeps_strings_ = false;
    std::deque<Text> texts_;
    std::array<const Text*, nvtx::kNumWords> words_{};
    std::array<std::uint64_t, nvtx::kNumSchemas> schemas_{};  // 0: not taken
    std::uint64_t gpu_time_ = 0;                              // time domain; 0: none
};

}  // namespace urgengo::observe
