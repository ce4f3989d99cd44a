// SPDX-License-Identifier: Apache-2.0
#include "host/observe/page_folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <optional>
#include <string_view>

#include "urgengo/abi/status_page.h"

namespace urgengo::observe {
namespace {

constexpr char kPrefix[] = "urgengo-";
/// /proc/<pid>/maps of a large program has a few thousand lines.
constexpr std::size_t kMostText = std::size_t{16} << 20;

/// @returns the file's text, all of it; none if it cannot be read to its end
std::optional<std::string> read_all(const std::string& path) {
    const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC);
    if (fd < 0) return std::nullopt;
    std::string text;
    char buffer[4096];
    ssize_t got;
    while ((got = read(fd, buffer, sizeof buffer)) != 0) {
        if (got < 0 && errno == EINTR) continue;
        if (got < 0 || text.size() > kMostText) break;
        text.append(buffer, static_cast<std::size_t>(got));
    }
    close(fd);
    if (got != 0) return std::nullopt;
    return text;
}

struct ProcessState {
    char state = 0;  ///< as ps shows it; 0: there is no such process, or /proc tells nothing
    std::uint64_t start_ticks = 0;
};

// The second field, the name, may hold spaces and brackets: fields are counted from its end.
/// @param process  folder in /proc
ProcessState read_state(const std::string& process) {
    const std::string text = read_all("/proc/" + process + "/stat").value_or("");
    const std::size_t name_end = text.rfind(')');
    if (name_end == std::string::npos || name_end + 2 >= text.size()) return {};
    ProcessState found{.state = text[name_end + 2]};
    std::size_t at = name_end + 2;
    for (int field = 3; field < 22; ++field) {  // the start is field 22, the state field 3
        at = text.find(' ', at);
        if (at++ == std::string::npos) return {};
    }
    std::from_chars(text.data() + at, text.data() + text.size(), found.start_ticks);
    return found;
}

std::uint64_t own_pid_namespace() {
    struct stat status {};
    return stat("/proc/self/ns/pid", &status) == 0 ? status.st_ino : 0;
}

std::string own_boot_id() {
    std::string text = read_all("/proc/sys/kernel/random/boot_id").value_or("");
    return text.substr(0, text.find('\n'));
}

/// The first thread may end before the others: its state is then that of a process that has ended.
bool has_other_threads(std::uint32_t process) {
    DIR* const threads = opendir(("/proc/" + std::to_string(process) + "/task").c_str());
    if (!threads) return false;
    int count = 0;
    while (const dirent* entry = readdir(threads)) count += entry->d_name[0] != '.';
    closedir(threads);
    return count > 1;
}

/// Whether numbers in /proc are those of our pid namespace: after `unshare --pid` without a new
/// /proc they are another's, and /proc/<getpid()> is another process.
bool is_proc_ours() {
    char name[24];
    const ssize_t length = readlink("/proc/self", name, sizeof name);
    return length > 0 &&
           std::string_view(name, static_cast<std::size_t>(length)) == std::to_string(getpid());
}

/// @returns whether the process has become another program since: its maps can be read to their
///          end, and the page is not among them
bool has_let_go(std::uint32_t process, const std::string& stem) {
    struct stat status {};
    if (stat((stem + kPageSuffix).c_str(), &status) != 0) return false;
    const auto maps = read_all("/proc/" + std::to_string(process) + "/maps");
    if (!maps || maps->empty()) return false;
    const std::string name = stem.substr(stem.rfind('/') + 1) + kPageSuffix;
    return maps->find(name) == std::string::npos;
}

bool has_records(const std::string& stem) {
    return access((stem + kRecordsSuffix).c_str(), F_OK) == 0;
}

/// @returns whether the process runs as that user: real, effective, saved or for files. Not the
///          owner of /proc/<process>, which is root where the process cannot be dumped
bool runs_as(std::uint32_t process, std::uint32_t user) {
    constexpr std::string_view kField = "\nUid:";
    const std::string text = read_all("/proc/" + std::to_string(process) + "/status").value_or("");
    std::size_t at = text.find(kField);
    if (at == std::string::npos) return false;
    at += kField.size();
    const char* const end = text.data() + std::min(text.find('\n', at), text.size());
    for (const char* next = text.data() + at; next < end;) {
        std::uint32_t found = 0;
        const auto [last, error] = std::from_chars(next + 1, end, found);  // behind a tab
        if (error != std::errc{}) return false;
        if (found == user) return true;
        next = last;
    }
    return false;
}

}  // namespace

ProcessKey own_process() {
    return {static_cast<std::uint32_t>(getpid()), read_state("self").start_ticks,
            own_pid_namespace(), own_boot_id()};
}

std::string page_stem(const ProcessKey& process) {
    return kPrefix + std::to_string(process.pid_namespace) + "-" + std::to_string(process.process) +
           "-" + std::to_string(process.start_ticks);
}

std::vector<std::string> list_pages(const std::string& folder) {
    std::vector<std::string> stems;
    DIR* const opened = opendir(folder.c_str());
    if (!opened) return stems;
    while (const dirent* entry = readdir(opened)) {
        const std::string_view name = entry->d_name;
        if (name.starts_with(kPrefix) && name.ends_with(kPageSuffix))
            stems.push_back(folder + "/" +
                            std::string(name.substr(0, name.size() - sizeof kPageSuffix + 1)));
    }
    closedir(opened);
    std::sort(stems.begin(), stems.end());
    return stems;
}

Liveness liveness_of(const ProcessKey& process, const std::string& stem, bool looks_for_exec) {
    const std::uint64_t own = own_pid_namespace();
    if (own == 0 || process.pid_namespace != own || !is_proc_ours()) return Liveness::kElsewhere;
    const ProcessState state = read_state(std::to_string(process.process));
    if (state.state == 0) {  // or /proc hides others' processes
        const bool is_there = kill(static_cast<pid_t>(process.process), 0) == 0 || errno == EPERM;
        return is_there ? Liveness::kThere : Liveness::kGone;
    }
    const bool has_ended = state.state == 'Z' || state.state == 'X';
    if (has_ended && !has_other_threads(process.process)) return Liveness::kGone;
    if (process.start_ticks != 0 && state.start_ticks != process.start_ticks)
        return Liveness::kGone;
    if (looks_for_exec && has_let_go(process.process, stem)) return Liveness::kGone;
    return state.state == 'T' || state.state == 't' ? Liveness::kStopped : Liveness::kThere;
}

bool may_be_of(const PageFile& file, const ProcessKey& process, Liveness liveness) {
    if (file.user == geteuid() || file.user == 0) return true;
    if (file.is_for_all || liveness == Liveness::kElsewhere) return false;
    return runs_as(process.process, file.user);
}

bool remove_page(const std::string& stem) {
    unlink((stem + kControlSuffix).c_str());
    unlink((stem + kRecordsSuffix).c_str());
    return unlink((stem + kPageSuffix).c_str()) == 0 || errno == ENOENT;
}

void end_page(const std::string& stem, bool has_tripped) {
    if (has_tripped && has_records(stem))
        unlink((stem + kControlSuffix).c_str());
    else
        remove_page(stem);
}

int remove_stale_pages(const std::string& folder, bool looks_for_exec) {
    struct Kept {
        std::uint32_t user;
        std::int64_t begin_ns;
        std::string stem;
    };
    std::vector<Kept> kept;
    int removed = 0;
    for (const std::string& stem : list_pages(folder)) {
        const int fd =
            open((stem + kPageSuffix).c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
        if (fd < 0) continue;
        struct stat status {};
        abi::StatusHeader header;
        const bool is_ours = fstat(fd, &status) == 0 && S_ISREG(status.st_mode) &&
                             (status.st_uid == geteuid() || geteuid() == 0) &&
                             pread(fd, static_cast<void*>(&header), sizeof header, 0) ==
                                 static_cast<ssize_t>(sizeof header) &&
                             header.magic == abi::kStatusMagic;
        close(fd);
        if (!is_ours) continue;
        header.boot_id[sizeof header.boot_id - 1] = 0;
        const ProcessKey key{header.process, header.start_ticks, header.pid_namespace,
                             header.boot_id};
        const bool has_tripped = header.mode.load() == abi::StatusMode::kTripped;
        // In another pid namespace it has said itself that it was over.
        const bool has_ended = (has_tripped && header.is_over.load() != 0) ||
                               liveness_of(key, stem, looks_for_exec) == Liveness::kGone;
        if (!has_ended) continue;
        if (has_tripped && has_records(stem))
            kept.push_back({status.st_uid, header.begin_ns, stem});
        else if (remove_page(stem))
            ++removed;
    }
    std::sort(kept.begin(), kept.end(), [](const Kept& a, const Kept& b) {
        return a.user != b.user ? a.user < b.user : a.begin_ns > b.begin_ns;
    });
    for (std::size_t i = kMostKept; i < kept.size(); ++i)
        if (kept[i].user == kept[i - kMostKept].user && remove_page(kept[i].stem)) ++removed;
    return removed;
}

}  // namespace urgengo::observe
