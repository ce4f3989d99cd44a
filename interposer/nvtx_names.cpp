// SPDX-License-Identifier: Apache-2.0
#include "interposer/nvtx_names.h"

#include <pthread.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <cwchar>
#include <mutex>
#include <new>
#include <string>
#include <unordered_set>
#include <utility>

#include "host/base/log.h"

namespace urgengo::interposer {

Utf8::Utf8(const char* text) {
    if (text) view_ = {text, strnlen(text, kMaxBytes)};
}

Utf8::Utf8(const wchar_t* text) {
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

namespace {

// Guards all Names, and additions to the noted ones. Taken around every fork: a child would find it
// locked by a thread that it does not have.
constinit std::mutex g_names_mutex;
std::atomic<bool> g_said_too_many{false};

void say_too_many() {
    if (!g_said_too_many.exchange(true))
        log_line("NVTX: the program names more than " + std::to_string(kMaxNames) +
                 " strings or domains; those after them have no name here");
}

// Texts that handles are kept of, for good.
class Names {
  public:
    /// @returns the text's place for good; null if there are too many, or no memory
    const std::string* keep(std::string_view name) {
        const int saved_errno = errno;
        const std::string* text = nullptr;
        try {
            text = find_or_add(std::string(name));
            if (!text) say_too_many();
        } catch (...) {  // no memory: the null handle names nothing
        }
        errno = saved_errno;
        return text;
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
Names& strings() {
    static auto* const all = new Names;
    return *all;
}
Names& domains() {
    static auto* const all = new Names;
    return *all;
}

// Another tool's handles: lists that only grow, at their heads, so that they are read without a
// lock.
struct Noted {
    nvtxDomainHandle_t domain;
    nvtxStringHandle_t handle;
    std::atomic<const std::string*> text;  // what it was given for last
    Noted* next;
};
std::array<std::atomic<Noted*>, 4096> g_noted;
std::size_t g_num_noted = 0;  // under g_names_mutex

std::atomic<Noted*>& noted_list(nvtxDomainHandle_t domain, nvtxStringHandle_t handle) {
    const auto mixed =
        (reinterpret_cast<std::uintptr_t>(domain) * 31 + reinterpret_cast<std::uintptr_t>(handle)) *
        std::uint64_t{0x9e3779b97f4a7c15};
    return g_noted[mixed >> 52];
}

Noted* find_noted(nvtxDomainHandle_t domain, nvtxStringHandle_t handle) {
    Noted* noted = noted_list(domain, handle).load(std::memory_order_acquire);
    while (noted && (noted->domain != domain || noted->handle != handle)) noted = noted->next;
    return noted;
}

}  // namespace

bool prepare_names() {
    static const bool unlocks_in_children =
        pthread_atfork([] { g_names_mutex.lock(); }, [] { g_names_mutex.unlock(); },
                       [] { g_names_mutex.unlock(); }) == 0;
    if (!unlocks_in_children) return false;
    strings();
    domains();
    return true;
}

nvtxStringHandle_t own_string(std::string_view text) {
    return reinterpret_cast<nvtxStringHandle_t>(const_cast<std::string*>(strings().keep(text)));
}

nvtxDomainHandle_t own_domain(std::string_view name) {
    return reinterpret_cast<nvtxDomainHandle_t>(const_cast<std::string*>(domains().keep(name)));
}

std::string_view text_of(nvtxStringHandle_t own) {
    const auto* text = reinterpret_cast<const std::string*>(own);
    return text ? std::string_view(*text) : std::string_view();
}

void note_string(nvtxDomainHandle_t domain, nvtxStringHandle_t handle, std::string_view text) {
    const std::string* const kept = handle ? strings().keep(text) : nullptr;
    if (!kept) return;
    const std::lock_guard lock(g_names_mutex);
    if (Noted* known = find_noted(domain, handle)) {
        known->text.store(kept, std::memory_order_release);
        return;
    }
    if (g_num_noted == kMaxNames) return say_too_many();
    std::atomic<Noted*>& list = noted_list(domain, handle);
    auto* noted =
        new (std::nothrow) Noted{domain, handle, {kept}, list.load(std::memory_order_relaxed)};
    if (!noted) return;
    ++g_num_noted;
    list.store(noted, std::memory_order_release);
}

std::string_view noted_text(nvtxDomainHandle_t domain, nvtxStringHandle_t handle) {
    const Noted* noted = handle ? find_noted(domain, handle) : nullptr;
    return noted ? std::string_view(*noted->text.load(std::memory_order_acquire))
                 : std::string_view();
}

}  // namespace urgengo::interposer
