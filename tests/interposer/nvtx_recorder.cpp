// SPDX-License-Identifier: Apache-2.0
#include "tests/interposer/nvtx_recorder.h"

#include <fcntl.h>
#include <unistd.h>

#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <cwchar>
#include <map>
#include <mutex>
#include <set>
#include <string_view>
#include <thread>
#include <tuple>

#define EXPORT extern "C" __attribute__((visibility("default")))

namespace recorder {
namespace {

struct State {
    std::mutex mutex;
    std::map<std::tuple<std::string, nvtxDomainHandle_t, std::uint64_t>, std::string> names;
    std::map<std::pair<std::thread::id, nvtxDomainHandle_t>, int> depth;
    std::map<nvtxDomainHandle_t, std::uint64_t> num_started;
    std::set<std::pair<nvtxDomainHandle_t, nvtxRangeId_t>> started;
};
State& state() {
    static auto* const all = new State;
    return *all;
}

void write_line(const std::string& line) {
    static const int file = [] {
        const char* const path = std::getenv("NVTX_RECORDER_FILE");
        return path ? open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600) : -1;
    }();
    if (file >= 0 && write(file, line.data(), line.size()) < 0) std::_Exit(98);
}

std::string text(const char* format, std::va_list arguments) {
    char line[2048];
    std::vsnprintf(line, sizeof line, format, arguments);
    return line;
}

std::string narrow(const wchar_t* wide) {
    std::string all;
    for (; wide && *wide; ++wide) all += *wide < 0x80 ? static_cast<char>(*wide) : '?';
    return all;
}
std::string narrow(const char* text) {
    return text ? text : "(null)";
}

std::uint64_t hash(std::string_view text) {
    std::uint64_t sum = 1469598103934665603u;
    for (const char c : text) sum = (sum ^ static_cast<unsigned char>(c)) * 1099511628211u;
    return sum;
}

nvtxDomainHandle_t as_domain(std::uint64_t number) {
    return reinterpret_cast<nvtxDomainHandle_t>(number);
}

}  // namespace

bool lacks(const char* what) {
    const char* const list = std::getenv("NVTX_RECORDER_LACKS");
    return list && std::strstr(list, what);
}

void say(const char* format, ...) {
    std::va_list arguments;
    va_start(arguments, format);
    write_line(text(format, arguments) + "\n");
    va_end(arguments);
}

void wrong(const char* format, ...) {
    std::va_list arguments;
    va_start(arguments, format);
    write_line("ERROR " + text(format, arguments) + "\n");
    va_end(arguments);
}

std::uint64_t add(const char* kind, nvtxDomainHandle_t domain, const std::string& name) {
    // No address of a program, and above all that is a type or a scope by itself.
    const std::uint64_t number =
        (hash(std::string(kind) + "/" + name) >> 24) | (std::uint64_t{1} << 62);
    const std::lock_guard lock(state().mutex);
    state().names[{kind, domain, number}] = name;
    return number;
}

std::string name_of(const char* kind, nvtxDomainHandle_t domain, std::uint64_t number) {
    const std::lock_guard lock(state().mutex);
    const auto found = state().names.find({kind, domain, number});
    if (found != state().names.end()) return found->second;
    wrong("%s %#llx was not registered before its use", kind,
          static_cast<unsigned long long>(number));
    return "?";
}

std::string domain_name(nvtxDomainHandle_t domain) {
    return domain ? name_of("domain", nullptr, reinterpret_cast<std::uint64_t>(domain)) : "";
}

std::string message(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event) {
    if (!event) return "(null)";
    std::string text = "(none)";
    if (event->messageType == NVTX_MESSAGE_TYPE_ASCII) text = narrow(event->message.ascii);
    if (event->messageType == NVTX_MESSAGE_TYPE_UNICODE) text = narrow(event->message.unicode);
    if (event->messageType == NVTX_MESSAGE_TYPE_REGISTERED)
        text =
            name_of("string", domain, reinterpret_cast<std::uint64_t>(event->message.registered));
    if (event->category != 0) text += " (category " + std::to_string(event->category) + ")";
    if (event->payloadType == NVTX_PAYLOAD_TYPE_EXT)
        text +=
            payloads(domain, reinterpret_cast<const nvtxPayloadData_t*>(event->payload.ullValue),
                     static_cast<std::size_t>(event->reserved0));
    else if (event->payloadType != NVTX_PAYLOAD_UNKNOWN)
        text += " {" + std::to_string(event->payload.llValue) + "}";
    return text;
}

int push(nvtxDomainHandle_t domain) {
    const std::lock_guard lock(state().mutex);
    return state().depth[{std::this_thread::get_id(), domain}]++;
}

int pop(nvtxDomainHandle_t domain) {
    const std::lock_guard lock(state().mutex);
    int& depth = state().depth[{std::this_thread::get_id(), domain}];
    if (depth == 0) {
        wrong("pop without a push");
        return -1;
    }
    return --depth;
}

nvtxRangeId_t start(nvtxDomainHandle_t domain) {
    const std::lock_guard lock(state().mutex);
    const nvtxRangeId_t id = ++state().num_started[domain];
    state().started.insert({domain, id});
    return id;
}

void end(nvtxDomainHandle_t domain, nvtxRangeId_t id) {
    const std::lock_guard lock(state().mutex);
    if (state().started.erase({domain, id}) == 0)
        wrong("end of range %llu that was not started", static_cast<unsigned long long>(id));
}

namespace {

// By the process that was initialised: a child ends no range of its parent's.
pid_t g_process = 0;

void check_balance() {
    if (getpid() != g_process) return;
    const std::lock_guard lock(state().mutex);
    for (const auto& [where, depth] : state().depth)
        if (depth != 0) wrong("%d pushed ranges were not popped", depth);
    if (!state().started.empty()) wrong("%zu ranges were not ended", state().started.size());
}

template <typename Text>
void mark(const Text* text) {
    say("[] mark %s", narrow(text).c_str());
}
void NVTX_API domain_mark(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event) {
    say("[%s] mark %s", domain_name(domain).c_str(), message(domain, event).c_str());
}
void NVTX_API mark_ex(const nvtxEventAttributes_t* event) {
    domain_mark(nullptr, event);
}

int pushed(nvtxDomainHandle_t domain, const std::string& name) {
    const int depth = push(domain);
    say("[%s] push %s = %d", domain_name(domain).c_str(), name.c_str(), depth);
    return depth;
}
template <typename Text>
int push_text(const Text* text) {
    return pushed(nullptr, narrow(text));
}
int NVTX_API domain_push(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event) {
    return pushed(domain, message(domain, event));
}
int NVTX_API push_ex(const nvtxEventAttributes_t* event) {
    return domain_push(nullptr, event);
}
int NVTX_API domain_pop(nvtxDomainHandle_t domain) {
    const int depth = pop(domain);
    say("[%s] pop = %d", domain_name(domain).c_str(), depth);
    return depth;
}
int NVTX_API pop_default() {
    return domain_pop(nullptr);
}

nvtxRangeId_t started(nvtxDomainHandle_t domain, const std::string& name) {
    const nvtxRangeId_t id = start(domain);
    say("[%s] start %s = %llu", domain_name(domain).c_str(), name.c_str(),
        static_cast<unsigned long long>(id));
    return id;
}
template <typename Text>
nvtxRangeId_t start_text(const Text* text) {
    return started(nullptr, narrow(text));
}
nvtxRangeId_t NVTX_API domain_start(nvtxDomainHandle_t domain, const nvtxEventAttributes_t* event) {
    return started(domain, message(domain, event));
}
nvtxRangeId_t NVTX_API start_ex(const nvtxEventAttributes_t* event) {
    return domain_start(nullptr, event);
}
void NVTX_API domain_end(nvtxDomainHandle_t domain, nvtxRangeId_t id) {
    say("[%s] end %llu", domain_name(domain).c_str(), static_cast<unsigned long long>(id));
    end(domain, id);
}
void NVTX_API end_default(nvtxRangeId_t id) {
    domain_end(nullptr, id);
}

template <typename Text>
void domain_category(nvtxDomainHandle_t domain, std::uint32_t category, const Text* text) {
    say("[%s] category %u %s", domain_name(domain).c_str(), category, narrow(text).c_str());
}
template <typename Text>
void category(std::uint32_t number, const Text* text) {
    domain_category<Text>(nullptr, number, text);
}
template <typename Text>
void os_thread(std::uint32_t, const Text* text) {
    say("[] thread %s", narrow(text).c_str());
}
template <typename Text>
void cu_stream(nvtx_CUstream, const Text* text) {
    say("[] stream %s", narrow(text).c_str());
}

template <typename Text>
nvtxStringHandle_t register_string(nvtxDomainHandle_t domain, const Text* text) {
    const std::string name = narrow(text);
    say("[%s] string %s", domain_name(domain).c_str(), name.c_str());
    return reinterpret_cast<nvtxStringHandle_t>(add("string", domain, name));
}
template <typename Text>
nvtxDomainHandle_t create(const Text* text) {
    const std::string name = narrow(text);
    say("[] domain %s", name.c_str());
    return as_domain(add("domain", nullptr, name));
}
void NVTX_API destroy(nvtxDomainHandle_t domain) {
    say("[%s] destroyed", domain_name(domain).c_str());
}
nvtxResourceHandle_t NVTX_API resource(nvtxDomainHandle_t domain,
                                       nvtxResourceAttributes_t* attributes) {
    const std::string name = narrow(attributes->message.ascii);
    say("[%s] resource %s", domain_name(domain).c_str(), name.c_str());
    return reinterpret_cast<nvtxResourceHandle_t>(add("resource", nullptr, name));
}
void NVTX_API destroy_resource(nvtxResourceHandle_t handle) {
    say("[] resource destroyed %s",
        name_of("resource", nullptr, reinterpret_cast<std::uint64_t>(handle)).c_str());
}

nvtx_nvtxSyncUser_t NVTX_API sync_create(nvtxDomainHandle_t domain,
                                         const nvtx_nvtxSyncUserAttributes_t*) {
    say("[%s] sync", domain_name(domain).c_str());
    return reinterpret_cast<nvtx_nvtxSyncUser_t>(add("sync", nullptr, "sync"));
}
template <int kWhat>
void sync(nvtx_nvtxSyncUser_t handle) {
    say("[] %s %d", name_of("sync", nullptr, reinterpret_cast<std::uint64_t>(handle)).c_str(),
        kWhat);
}

using GetTable = decltype(NvtxExportTableCallbacks::GetModuleFunctionTable);

template <typename Function>
void listen(GetTable get_table, NvtxCallbackModule module, unsigned id, Function* function) {
    NvtxFunctionTable table = nullptr;
    unsigned size = 0;
    if (!get_table(module, &table, &size) || id >= size || !table[id])
        return wrong("NVTX has no callback %u of module %d", id, module);
    *table[id] = reinterpret_cast<NvtxFunctionPointer>(function);
}

}  // namespace
}  // namespace recorder

EXPORT int InitializeInjectionNvtx2(NvtxGetExportTableFunc_t get_export_table) {
    using namespace recorder;
    say("init");
    const auto* callbacks =
        static_cast<const NvtxExportTableCallbacks*>(get_export_table(NVTX_ETID_CALLBACKS));
    const auto* version =
        static_cast<const NvtxExportTableVersionInfo*>(get_export_table(NVTX_ETID_VERSIONINFO));
    if (!version || version->version != NVTX_VERSION) wrong("no version of NVTX");
    const auto core = [&](NvtxCallbackIdCore id, auto* function) {
        listen(callbacks->GetModuleFunctionTable, NVTX_CB_MODULE_CORE, id, function);
    };
    const auto core2 = [&](NvtxCallbackIdCore2 id, auto* function) {
        listen(callbacks->GetModuleFunctionTable, NVTX_CB_MODULE_CORE2, id, function);
    };
    core(NVTX_CBID_CORE_RangePushEx, push_ex);
    if (lacks("init")) return 0;  // after it has put something in
    g_process = getpid();
    static const bool checks = std::atexit(check_balance) == 0;
    if (!checks) wrong("atexit");
    core(NVTX_CBID_CORE_MarkEx, mark_ex);
    core(NVTX_CBID_CORE_MarkA, mark<char>);
    core(NVTX_CBID_CORE_MarkW, mark<wchar_t>);
    core(NVTX_CBID_CORE_RangeStartEx, start_ex);
    core(NVTX_CBID_CORE_RangeStartA, start_text<char>);
    core(NVTX_CBID_CORE_RangeStartW, start_text<wchar_t>);
    core(NVTX_CBID_CORE_RangeEnd, end_default);
    core(NVTX_CBID_CORE_RangePushA, push_text<char>);
    core(NVTX_CBID_CORE_RangePushW, push_text<wchar_t>);
    core(NVTX_CBID_CORE_RangePop, pop_default);
    core(NVTX_CBID_CORE_NameCategoryA, category<char>);
    core(NVTX_CBID_CORE_NameCategoryW, category<wchar_t>);
    core(NVTX_CBID_CORE_NameOsThreadA, os_thread<char>);
    core(NVTX_CBID_CORE_NameOsThreadW, os_thread<wchar_t>);
    core2(NVTX_CBID_CORE2_DomainMarkEx, domain_mark);
    core2(NVTX_CBID_CORE2_DomainRangeStartEx, domain_start);
    core2(NVTX_CBID_CORE2_DomainRangeEnd, domain_end);
    core2(NVTX_CBID_CORE2_DomainRangePushEx, domain_push);
    core2(NVTX_CBID_CORE2_DomainRangePop, domain_pop);
    core2(NVTX_CBID_CORE2_DomainResourceCreate, resource);
    core2(NVTX_CBID_CORE2_DomainResourceDestroy, destroy_resource);
    core2(NVTX_CBID_CORE2_DomainNameCategoryA, domain_category<char>);
    core2(NVTX_CBID_CORE2_DomainNameCategoryW, domain_category<wchar_t>);
    if (!lacks("strings")) {
        core2(NVTX_CBID_CORE2_DomainRegisterStringA, register_string<char>);
        core2(NVTX_CBID_CORE2_DomainRegisterStringW, register_string<wchar_t>);
    }
    core2(NVTX_CBID_CORE2_DomainCreateA, create<char>);
    core2(NVTX_CBID_CORE2_DomainCreateW, create<wchar_t>);
    core2(NVTX_CBID_CORE2_DomainDestroy, destroy);
    const GetTable table = callbacks->GetModuleFunctionTable;
    listen(table, NVTX_CB_MODULE_CUDA, NVTX_CBID_CUDA_NameCuStreamA, cu_stream<char>);
    listen(table, NVTX_CB_MODULE_CUDA, NVTX_CBID_CUDA_NameCuStreamW, cu_stream<wchar_t>);
    listen(table, NVTX_CB_MODULE_SYNC, NVTX_CBID_SYNC_DomainSyncUserCreate, sync_create);
    listen(table, NVTX_CB_MODULE_SYNC, NVTX_CBID_SYNC_DomainSyncUserAcquireStart, sync<1>);
    listen(table, NVTX_CB_MODULE_SYNC, NVTX_CBID_SYNC_DomainSyncUserDestroy, sync<2>);
    return 1;
}
