// SPDX-License-Identifier: Apache-2.0
#include "interposer/nvtx_tool.h"

// Types only: the implementation is for programs.
#define NVTX_NO_IMPL
#include <nvtx3/nvToolsExt.h>
#include <pthread.h>

#include <atomic>
#include <cerrno>
#include <cstring>
#include <cwchar>
#include <mutex>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>

#include "host/base/log.h"
#include "host/observe/nvtx_ranges.h"

namespace urgengo::interposer {
namespace {

constexpr std::size_t kMaxBytes = observe::RangeStack::kMaxNameBytes;

// Text as we keep it: UTF-8, cut.
class Utf8 {
  public:
    explicit Utf8(const char* text) {
        if (text) view_ = {text, strnlen(text, kMaxBytes)};
    }
    explicit Utf8(const wchar_t* text) {
        std::size_t length = 0;
        const auto put = [&](unsigned byte) { buffer_[length++] = static_cast<char>(byte); };
        for (; text && *text && length + 4 <= kMaxBytes; ++text) {
            const auto c = static_cast<std::uint32_t>(*text);
            if (c < 0x80) {
                put(c);
                continue;
            }
            if (c < 0x800) {
                put(0xc0 | (c >> 6));
            } else {
                if (c < 0x10000) {
                    put(0xe0 | (c >> 12));
                } else {
                    put(0xf0 | ((c >> 18) & 7));
                    put(0x80 | ((c >> 12) & 0x3f));
                }
                put(0x80 | ((c >> 6) & 0x3f));
            }
            put(0x80 | (c & 0x3f));
        }
        view_ = {buffer_, length};
    }
    Utf8(const Utf8&) = delete;
    Utf8& operator=(const Utf8&) = delete;
    std::string_view view() const { return view_; }

  private:
    char buffer_[kMaxBytes];
    std::string_view view_;
};

/// More than any program has that names its strings once.
constexpr std::size_t kMaxNames = 65536;

// Guards all Names. Taken around every fork: a child would find it locked by a thread that it does
// not have.
constinit std::mutex g_names_mutex;
std::atomic<bool> g_said_too_many{false};

void say_too_many() {
    if (!g_said_too_many.exchange(true))
        log_line("NVTX: the program names more than " + std::to_string(kMaxNames) +
                 " strings or domains; those after them have no name here");
}

/// @returns whether the names are unlocked in every child from here on
bool unlocks_in_children() {
    static const bool handled =
        pthread_atfork([] { g_names_mutex.lock(); }, [] { g_names_mutex.unlock(); },
                       [] { g_names_mutex.unlock(); }) == 0;
    return handled;
}

// Names that the program keeps handles of, for good. A handle is the address of its text.
template <typename Handle>
class Names {
  public:
    Handle handle(std::string_view name) {
        const int saved_errno = errno;
        const std::string* text = nullptr;
        try {
            text = find_or_add(std::string(name));
            if (!text) say_too_many();
        } catch (...) {  // no memory: the null handle names nothing
        }
        errno = saved_errno;
        return reinterpret_cast<Handle>(const_cast<std::string*>(text));
    }
    static std::string_view name(Handle handle) {
        const auto* text = reinterpret_cast<const std::string*>(handle);
        return text ? std::string_view(*text) : std::string_view();
    }

  private:
    /// @returns null if it is new and there are too many
    const std::string* find_or_add(std::string name) {
        const std::lock_guard lock(g_names_mutex);
        if (names_.size() < kMaxNames) return &*names_.insert(std::move(name)).first;
        const auto found = names_.find(name);
        return found == names_.end() ? nullptr : &*found;
    }

    std::unordered_set<std::string> names_;
};

// Never destroyed: libraries may use their handles until the process is gone.
Names<nvtxStringHandle_t>& strings() {
    static auto* const all = new Names<nvtxStringHandle_t>;
    return *all;
}
Names<nvtxDomainHandle_t>& domains() {
    static auto* const all = new Names<nvtxDomainHandle_t>;
    return *all;
}

std::atomic<const RangeListener*> g_listener{nullptr};

int push(nvtxDomainHandle_t domain, std::string_view name) {
    const int saved_errno = errno;
    if (auto* ranges = observe::make_this_thread_ranges()) {
        ranges->push(name, domain);
        if (const auto* listener = g_listener.load(std::memory_order_acquire))
            listener->pushed(name);
    }
    errno = saved_errno;
    return NVTX_NO_PUSH_POP_TRACKING;  // as without a tool
}

int NVTX_API domain_range_push_ex(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event) {
    // A range without a name is a range: something will pop it.
    if (event) {
        if (event->messageType == NVTX_MESSAGE_TYPE_ASCII)
            return push(domain, Utf8(event->message.ascii).view());
        if (event->messageType == NVTX_MESSAGE_TYPE_UNICODE)
            return push(domain, Utf8(event->message.unicode).view());
        if (event->messageType == NVTX_MESSAGE_TYPE_REGISTERED)
            return push(domain, strings().name(event->message.registered));
    }
    return push(domain, {});
}

int NVTX_API range_push_ex(const nvtxEventAttributes_t* event) {
    return domain_range_push_ex(nullptr, event);
}
int NVTX_API range_push_a(const char* name) {
    return push(nullptr, Utf8(name).view());
}
int NVTX_API range_push_w(const wchar_t* name) {
    return push(nullptr, Utf8(name).view());
}

int NVTX_API domain_range_pop(nvtxDomainHandle_t domain) {
    if (observe::this_thread_ranges()) {
        observe::make_this_thread_ranges()->pop(domain);
        if (const auto* listener = g_listener.load(std::memory_order_acquire)) listener->popped();
    }
    return NVTX_NO_PUSH_POP_TRACKING;
}
int NVTX_API range_pop() {
    return domain_range_pop(nullptr);
}

nvtxStringHandle_t NVTX_API register_string_a(nvtxDomainHandle_t, const char* text) {
    return strings().handle(Utf8(text).view());
}
nvtxStringHandle_t NVTX_API register_string_w(nvtxDomainHandle_t, const wchar_t* text) {
    return strings().handle(Utf8(text).view());
}
nvtxDomainHandle_t NVTX_API domain_create_a(const char* name) {
    return domains().handle(Utf8(name).view());
}
nvtxDomainHandle_t NVTX_API domain_create_w(const wchar_t* name) {
    return domains().handle(Utf8(name).view());
}

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

}  // namespace

void listen_to_ranges(const RangeListener& listener) {
    g_listener.store(new RangeListener(listener), std::memory_order_release);
}

bool attach_to_nvtx(NvtxTables tables) {
    const auto* callbacks =
        tables ? static_cast<const NvtxExportTableCallbacks*>(tables(NVTX_ETID_CALLBACKS))
               : nullptr;
    if (!callbacks || callbacks->struct_size < sizeof(NvtxExportTableCallbacks) ||
        !callbacks->GetModuleFunctionTable)
        return false;
    const Subscription subscriptions[] = {
        core(NVTX_CBID_CORE_RangePushEx, range_push_ex),
        core(NVTX_CBID_CORE_RangePushA, range_push_a),
        core(NVTX_CBID_CORE_RangePushW, range_push_w),
        core(NVTX_CBID_CORE_RangePop, range_pop),
        core2(NVTX_CBID_CORE2_DomainRangePushEx, domain_range_push_ex),
        core2(NVTX_CBID_CORE2_DomainRangePop, domain_range_pop),
        core2(NVTX_CBID_CORE2_DomainRegisterStringA, register_string_a),
        core2(NVTX_CBID_CORE2_DomainRegisterStringW, register_string_w),
        core2(NVTX_CBID_CORE2_DomainCreateA, domain_create_a),
        core2(NVTX_CBID_CORE2_DomainCreateW, domain_create_w),
    };
    const auto slot = [&](const Subscription& s) -> NvtxFunctionPointer* {
        NvtxFunctionTable table = nullptr;
        unsigned size = 0;
        if (!callbacks->GetModuleFunctionTable(s.module, &table, &size) || !table ||
            s.callback >= size)
            return nullptr;
        return table[s.callback];
    };
    if (!unlocks_in_children()) return false;
    // Made now: a child would wait for ever for a thread that was making one.
    strings();
    domains();
    // All or none: a pop without its push would end another range.
    for (const Subscription& s : subscriptions)
        if (!slot(s)) return false;
    for (const Subscription& s : subscriptions) *slot(s) = s.function;
    return true;
}

}  // namespace urgengo::interposer
