// SPDX-License-Identifier: Apache-2.0
#include "interposer/nvtx_tool.h"

#include <atomic>
#include <cerrno>
#include <span>
#include <string_view>
#include <vector>

#include "host/base/log.h"
#include "host/observe/nvtx_ranges.h"
#include "interposer/nvtx_names.h"

namespace urgengo::interposer {
namespace {

std::atomic<const RangeListener*> g_listener{nullptr};

// What the tool behind us has put into the tables where we listen; null where it does not listen.
struct Behind {
    nvtxRangePushEx_impl_fntype range_push_ex = nullptr;
    nvtxRangePushA_impl_fntype range_push_a = nullptr;
    nvtxRangePushW_impl_fntype range_push_w = nullptr;
    nvtxRangePop_impl_fntype range_pop = nullptr;
    nvtxDomainRangePushEx_impl_fntype domain_range_push_ex = nullptr;
    nvtxDomainRangePop_impl_fntype domain_range_pop = nullptr;
    nvtxDomainRegisterStringA_impl_fntype register_string_a = nullptr;
    nvtxDomainRegisterStringW_impl_fntype register_string_w = nullptr;
    bool operator==(const Behind&) const = default;
};
// Of the first copy of NVTX that it has attached to.
std::atomic<const Behind*> g_behind{nullptr};

const Behind& behind() {
    return *g_behind.load(std::memory_order_acquire);
}

void pushed(nvtxDomainHandle_t domain, std::string_view name) {
    const int saved_errno = errno;
    if (auto* ranges = observe::make_this_thread_ranges()) {
        ranges->push(name, domain);
        if (const auto* listener = g_listener.load(std::memory_order_acquire))
            listener->pushed(name);
    }
    errno = saved_errno;
}

void popped(nvtxDomainHandle_t domain) {
    if (!observe::this_thread_ranges()) return;
    observe::make_this_thread_ranges()->pop(domain);
    if (const auto* listener = g_listener.load(std::memory_order_acquire)) listener->popped();
}

// What NVTX calls: in copies that have the tool behind us (kForwards), and in those that have not.
template <bool kForwards>
struct Callbacks {
    /// @returns what the tool's function returns; without one what NVTX returns then
    template <typename Result, typename... Parameters, typename... Arguments>
    static Result forward(Result (*Behind::*function)(Parameters...), Result without,
                          Arguments... arguments) {
        if constexpr (kForwards)
            if (auto* const its = behind().*function) return its(arguments...);
        return without;
    }

    static void push(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event) {
        // A range without a name is a range: something will pop it.
        if (event) {
            if (event->messageType == NVTX_MESSAGE_TYPE_ASCII)
                return pushed(domain, Utf8(event->message.ascii).view());
            if (event->messageType == NVTX_MESSAGE_TYPE_UNICODE)
                return pushed(domain, Utf8(event->message.unicode).view());
            if (event->messageType == NVTX_MESSAGE_TYPE_REGISTERED)
                return pushed(domain, kForwards ? noted_text(domain, event->message.registered)
                                                : text_of(event->message.registered));
        }
        pushed(domain, {});
    }

    static int NVTX_API domain_range_push_ex(nvtxDomainHandle_t domain,
                                             const nvtxEventAttributes_t* event) {
        push(domain, event);
        return forward(&Behind::domain_range_push_ex, kNoTracking, domain, event);
    }
    static int NVTX_API range_push_ex(const nvtxEventAttributes_t* event) {
        push(nullptr, event);
        return forward(&Behind::range_push_ex, kNoTracking, event);
    }
    static int NVTX_API range_push_a(const char* name) {
        pushed(nullptr, Utf8(name).view());
        return forward(&Behind::range_push_a, kNoTracking, name);
    }
    static int NVTX_API range_push_w(const wchar_t* name) {
        pushed(nullptr, Utf8(name).view());
        return forward(&Behind::range_push_w, kNoTracking, name);
    }
    static int NVTX_API domain_range_pop(nvtxDomainHandle_t domain) {
        popped(domain);
        return forward(&Behind::domain_range_pop, kNoTracking, domain);
    }
    static int NVTX_API range_pop() {
        popped(nullptr);
        return forward(&Behind::range_pop, kNoTracking);
    }

    // The handle is the tool's, even if it is none: it would look into one of ours.
    template <typename Function, typename Text>
    static nvtxStringHandle_t register_string(Function function, nvtxDomainHandle_t domain,
                                              const Text* text) {
        if constexpr (!kForwards) return own_string(Utf8(text).view());
        const nvtxStringHandle_t handle =
            forward(function, nvtxStringHandle_t(nullptr), domain, text);
        note_string(domain, handle, Utf8(text).view());
        return handle;
    }
    static nvtxStringHandle_t NVTX_API register_string_a(nvtxDomainHandle_t domain,
                                                         const char* text) {
        return register_string(&Behind::register_string_a, domain, text);
    }
    static nvtxStringHandle_t NVTX_API register_string_w(nvtxDomainHandle_t domain,
                                                         const wchar_t* text) {
        return register_string(&Behind::register_string_w, domain, text);
    }

    static constexpr int kNoTracking = NVTX_NO_PUSH_POP_TRACKING;  // as without a tool
};

nvtxDomainHandle_t NVTX_API domain_create_a(const char* name) {
    return own_domain(Utf8(name).view());
}
nvtxDomainHandle_t NVTX_API domain_create_w(const wchar_t* name) {
    return own_domain(Utf8(name).view());
}

// One place in NVTX's tables.
using Slot = NvtxFunctionPointer*;

struct Subscription {
    NvtxCallbackModule module;
    unsigned callback;
    NvtxFunctionPointer function;
};

template <typename Function>
Subscription core(NvtxCallbackIdCore id, Function* function) {
    return {NVTX_CB_MODULE_CORE, id, reinterpret_cast<NvtxFunctionPointer>(function)};
}
template <typename Function>
Subscription core2(NvtxCallbackIdCore2 id, Function* function) {
    return {NVTX_CB_MODULE_CORE2, id, reinterpret_cast<NvtxFunctionPointer>(function)};
}

// The first eight in the order of Behind.
template <bool kForwards>
std::span<const Subscription> subscriptions() {
    using Ours = Callbacks<kForwards>;
    static const Subscription all[] = {
        core(NVTX_CBID_CORE_RangePushEx, Ours::range_push_ex),
        core(NVTX_CBID_CORE_RangePushA, Ours::range_push_a),
        core(NVTX_CBID_CORE_RangePushW, Ours::range_push_w),
        core(NVTX_CBID_CORE_RangePop, Ours::range_pop),
        core2(NVTX_CBID_CORE2_DomainRangePushEx, Ours::domain_range_push_ex),
        core2(NVTX_CBID_CORE2_DomainRangePop, Ours::domain_range_pop),
        core2(NVTX_CBID_CORE2_DomainRegisterStringA, Ours::register_string_a),
        core2(NVTX_CBID_CORE2_DomainRegisterStringW, Ours::register_string_w),
        core2(NVTX_CBID_CORE2_DomainCreateA, domain_create_a),
        core2(NVTX_CBID_CORE2_DomainCreateW, domain_create_w),
    };
    // Domains are told apart by their handles: the other tool's do.
    return std::span(all).first(kForwards ? 8 : 10);
}

// The tables of one copy of NVTX.
class Tables {
  public:
    explicit Tables(const NvtxExportTableCallbacks& callbacks) : callbacks_(callbacks) {}

    /// @returns null if this NVTX has no such callback
    Slot slot(unsigned module, unsigned callback) const {
        NvtxFunctionTable table = nullptr;
        unsigned size = 0;
        if (!callbacks_.GetModuleFunctionTable(static_cast<NvtxCallbackModule>(module), &table,
                                               &size) ||
            !table || callback >= size)
            return nullptr;
        return table[callback];
    }
    Slot slot(const Subscription& s) const { return slot(s.module, s.callback); }

    struct Value {
        Slot slot;
        NvtxFunctionPointer function;
    };
    /// @returns what is in all tables, those of later versions, too
    std::vector<Value> values() const {
        constexpr unsigned kMostModules = 32, kMostCallbacks = 256;
        std::vector<Value> all;
        for (unsigned module = 1; module < kMostModules; ++module) {
            NvtxFunctionTable table = nullptr;
            unsigned size = 0;
            if (!callbacks_.GetModuleFunctionTable(static_cast<NvtxCallbackModule>(module), &table,
                                                   &size) ||
                !table)
                continue;
            for (unsigned i = 0; i < size && i < kMostCallbacks; ++i)
                if (table[i]) all.push_back({table[i], *table[i]});
        }
        return all;
    }

  private:
    const NvtxExportTableCallbacks& callbacks_;
};

// @returns what the tool has put into the places of `ours`, which held `before`
Behind put_by_tool(const Tables& tables, std::span<const Subscription> ours,
                   const std::vector<Tables::Value>& before) {
    NvtxFunctionPointer put[8] = {};
    for (std::size_t i = 0; i < ours.size(); ++i) {
        const Slot slot = tables.slot(ours[i]);
        for (const Tables::Value& value : before)
            if (value.slot == slot && *slot != value.function) put[i] = *slot;
    }
    static_assert(sizeof put == sizeof(Behind));
    return __builtin_bit_cast(Behind, put);
}

// @returns whether it is what all copies of NVTX forward to: one function of ours cannot know in
// which copy it was called
bool share(const Behind& found) {
    const Behind* first = g_behind.load(std::memory_order_acquire);
    if (!first) {
        const auto* const mine = new Behind(found);
        if (g_behind.compare_exchange_strong(first, mine, std::memory_order_acq_rel)) return true;
        delete mine;
    }
    return *first == found;
}

void say_once(std::atomic<bool>& said, std::string_view line) {
    if (!said.exchange(true)) log_line(line);
}
std::atomic<bool> g_said_refused{false}, g_said_differs{false};

// All or none: a pop without its push would end another range.
bool subscribe(const Tables& tables, std::span<const Subscription> ours) {
    if (!prepare_names()) return false;
    for (const Subscription& s : ours)
        if (!tables.slot(s)) return false;
    for (const Subscription& s : ours) *tables.slot(s) = s.function;
    return true;
}

}  // namespace

void listen_to_ranges(const RangeListener& listener) {
    g_listener.store(new RangeListener(listener), std::memory_order_release);
}

bool nvtx_tool_has_refused() {
    return g_said_refused.load();
}

bool attach_to_nvtx(NvtxTables get_table, int (*behind)(NvtxTables)) {
    const auto* callbacks =
        get_table ? static_cast<const NvtxExportTableCallbacks*>(get_table(NVTX_ETID_CALLBACKS))
                  : nullptr;
    if (!callbacks || callbacks->struct_size < sizeof(NvtxExportTableCallbacks) ||
        !callbacks->GetModuleFunctionTable)
        return behind && behind(get_table) != 0;
    const Tables tables(*callbacks);
    if (!behind) return subscribe(tables, subscriptions<false>());

    const std::vector<Tables::Value> before = tables.values();
    if (behind(get_table) == 0) {
        for (const Tables::Value& value : before) *value.slot = value.function;
        say_once(g_said_refused, "NVTX: the tool behind UrgenGo refused to be initialised");
        return subscribe(tables, subscriptions<false>());
    }
    const auto ours = subscriptions<true>();
    for (const Subscription& s : ours)
        if (!tables.slot(s)) return true;  // the tool's alone
    if (share(put_by_tool(tables, ours, before)))
        subscribe(tables, ours);
    else
        say_once(g_said_differs,
                 "NVTX: the tool behind UrgenGo differs from one copy of NVTX to the other; ranges "
                 "of later ones are not seen here");
    return true;
}

}  // namespace urgengo::interposer
