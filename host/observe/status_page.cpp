// SPDX-License-Identifier: Apache-2.0
#include "host/observe/status_page.h"

#include <fcntl.h>
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <new>
#include <utility>

#include "host/base/file_descriptor.h"
#include "host/base/memory_orders.h"
#include "host/config/task_count.h"
#include "host/observe/shared_file.h"

namespace urgengo::observe {

abi::StatusMode to_status(config::Mode mode) {
    switch (mode) {
        case config::Mode::kOff:
            return abi::StatusMode::kOff;
        case config::Mode::kObserve:
            return abi::StatusMode::kObserve;
        case config::Mode::kShadow:
            return abi::StatusMode::kShadow;
        case config::Mode::kEnforce:
            break;
    }
    return abi::StatusMode::kEnforce;
}

StatusPage::StatusPage(const ShareOptions& options, const config::Config& config,
                       std::chrono::nanoseconds now, const config::Profile* profile)
    : process_(getpid()) {
    const KernelList kernels = list_kernels(config, profile);
    bytes_ = aligned(sizeof(abi::StatusHeader)) + aligned(sizeof(abi::SharedPage)) +
             aligned(sizeof(abi::ChainStatus) * config.chains.size()) +
             aligned(sizeof(abi::TaskStatus) * config::num_tasks(config.chains)) +
             aligned(sizeof(abi::PlannedLaunch) * kernels.launches.size()) +
             aligned(sizeof(abi::KernelName) * kernels.names.size());
    ProcessKey process;
    if (!options.folder.empty()) {
        process = own_process();
        if (!share(options, process)) stem_.clear();
    }
    if (!memory_) {
        memory_ = mmap(nullptr, bytes_, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        if (memory_ == MAP_FAILED) throw std::bad_alloc();
    }
    lay_out(process, config, now, kernels);
    if (!is_shared()) return;
    // A reader that finds it, finds it whole. It is there under its name from here on.
    if (std::rename((stem_ + ".new").c_str(), (stem_ + kPageSuffix).c_str()) == 0) return;
    note_ = stem_ + ": " + std::strerror(errno);
    unlink((stem_ + ".new").c_str());
    unlink((stem_ + kControlSuffix).c_str());
    munmap(std::exchange(control_, nullptr), aligned(sizeof(abi::ControlPage)));
    stem_.clear();
}

bool StatusPage::share(const ShareOptions& options, const ProcessKey& process) {
    std::optional<unsigned> group;
    if (!options.group.empty()) {
        group = find_group(options.group);
        if (!group) {
            note_ = "no group '" + options.group + "'";
            return false;
        }
    }
    if (const std::string why = why_not_in_memory(options.folder); !why.empty()) {
        note_ = options.folder + ": " + why;
        return false;
    }
    remove_stale_pages(options.folder, false);
    stem_ = options.folder + "/" + page_stem(process);
    memory_ = map_file(stem_ + ".new", bytes_, 0640, group).memory;
    if (!memory_ || !map_control(stem_, group)) {
        note_ = stem_ + ": " + std::strerror(errno);
        if (memory_) {
            unlink((stem_ + ".new").c_str());
            munmap(std::exchange(memory_, nullptr), bytes_);
        }
        return false;
    }
    return true;
}

bool StatusPage::map_control(const std::string& stem, std::optional<unsigned> group) {
    constexpr std::size_t kBytes = aligned(sizeof(abi::ControlPage));
    control_file_ = map_file(stem + kControlSuffix, kBytes, 0660, group);
    if (!control_file_.memory) return false;
    control_ = new (control_file_.memory)
        abi::ControlPage{abi::kControlMagic, abi::kStatusVersion, {}, {}, {}};
    return true;
}

void StatusPage::lay_out(const ProcessKey& process, const config::Config& config,
                         std::chrono::nanoseconds now, const KernelList& kernels) {
    std::size_t at = 0;
    const auto place = [&](std::size_t element, std::size_t count) {
        const abi::StatusSection section{at, static_cast<std::uint32_t>(element),
                                         static_cast<std::uint32_t>(count)};
        at += aligned(element * count);
        return section;
    };
    char* const base = static_cast<char*>(memory_);
    const auto make = [&]<typename T>(const abi::StatusSection& section, T*& first) {
        first = reinterpret_cast<T*>(base + section.offset);
        std::uninitialized_value_construct_n(first, section.count);
    };
    abi::StatusHeader& header = *new (memory_) abi::StatusHeader();
    header_ = &header;
    place(sizeof header, 1);
    header.version = abi::kStatusVersion;
    header.header_bytes = sizeof header;
    header.file_bytes = bytes_;
    header.process = process.process;
    header.user = geteuid();
    header.start_ticks = process.start_ticks;
    header.pid_namespace = process.pid_namespace;
    copy_name(header.boot_id, process.boot_id);
    copy_name(header.program, program_name());
    header.begin_ns = now.count();
    header.akb = place(sizeof(abi::SharedPage), 1);
    header.chains = place(sizeof(abi::ChainStatus), config.chains.size());
    header.tasks = place(sizeof(abi::TaskStatus), config::num_tasks(config.chains));
    header.launches = place(sizeof(abi::PlannedLaunch), kernels.launches.size());
    header.kernel_names = place(sizeof(abi::KernelName), kernels.names.size());
    header.mode.store(to_status(config.mode), kRelaxed);
    make(header.akb, akb_);
    make(header.chains, chains_);
    make(header.tasks, tasks_);
    std::copy(kernels.launches.begin(), kernels.launches.end(),
              reinterpret_cast<abi::PlannedLaunch*>(base + header.launches.offset));
    std::copy(kernels.names.begin(), kernels.names.end(),
              reinterpret_cast<abi::KernelName*>(base + header.kernel_names.offset));
    akb_->magic = abi::kSharedPageMagic;
    akb_->version = abi::kSharedPageVersion;
    akb_->slot_bytes = sizeof(abi::TaskSlot);
    std::uint32_t next_task = 0;
    for (std::size_t i = 0; i < config.chains.size(); ++i) {
        const config::Chain& from = config.chains[i];
        abi::ChainStatus& chain = chains_[i];
        copy_name(chain.name, from.name);
        describe(i, from);
        chain.first_task = next_task;
        chain.num_tasks = static_cast<std::uint32_t>(from.tasks.size());
        for (std::size_t stage = 0; stage < from.tasks.size(); ++stage) {
            abi::TaskStatus& task = tasks_[next_task];
            task.first_launch = kernels.first_launch[next_task++];
            copy_name(task.name, from.tasks[stage].name);
            task.chain = static_cast<std::uint32_t>(i);
            task.stage = static_cast<std::uint32_t>(stage);
        }
    }
    std::atomic_ref(header.magic).store(abi::kStatusMagic, std::memory_order_release);
}

static_assert(sizeof(StatusPage::Request) == sizeof(abi::ControlRequest));

void StatusPage::set_mode(config::Mode mode) {
    header_->mode.store(to_status(mode), kRelaxed);
}

void StatusPage::tripped() {
    header_->mode.store(abi::StatusMode::kTripped, kRelaxed);
}

StatusPage::~StatusPage() {
    retire();
    munmap(memory_, bytes_);
    if (control_) munmap(control_, aligned(sizeof(abi::ControlPage)));
}

void StatusPage::retire() {
    // The number is the parent's, and so is the page.
    if (!is_shared() || getpid() != process_) return;
    header_->is_over.store(1, kRelaxed);
    end_page(stem_, header_->mode.load(kRelaxed) == abi::StatusMode::kTripped);
}

// A load would be a SIGBUS where the file has been cut short; the kernel answers EFAULT.
bool StatusPage::read_control(std::size_t at, void* to, std::size_t bytes) const {
    if (!control_) return false;
    char* const memory = reinterpret_cast<char*>(control_) + at;
    const iovec target{to, bytes};
    const iovec from{memory, bytes};
    const long got = syscall(SYS_process_vm_readv, getpid(), &target, 1ul, &from, 1ul, 0ul);
    if (got == static_cast<long>(bytes)) return true;
    return (errno == ENOSYS || errno == EPERM) && read_control_file(at, to, bytes);
}

// Where a sandbox forbids to read memory so. By its name: programs close descriptors that they do
// not know.
bool StatusPage::read_control_file(std::size_t at, void* to, std::size_t bytes) const {
    const FileDescriptor file(open_again(stem_ + kControlSuffix, control_file_, O_RDONLY));
    return file.get() >= 0 &&
           pread(file.get(), to, bytes, static_cast<off_t>(at)) == static_cast<ssize_t>(bytes);
}

std::optional<std::uint32_t> StatusPage::control_word() const {
    std::uint32_t word = 0;
    if (!read_control(offsetof(abi::ControlPage, word), &word, sizeof word)) return std::nullopt;
    return word;
}

std::optional<StatusPage::Request> StatusPage::control_request(std::uint32_t word) const {
    const std::size_t index = abi::number_of(word) % abi::kControlRing;
    Request request;
    if (!read_control(offsetof(abi::ControlPage, requests) + index * sizeof(abi::ControlRequest),
                      &request, sizeof request) ||
        abi::number_of(request.word) != abi::number_of(word))
        return std::nullopt;
    return request;
}

void StatusPage::answer(std::uint32_t word, abi::ControlResult result) {
    abi::ControlAnswer& answer = header_->answers[abi::number_of(word) % abi::kControlRing];
    answer.result.store(result, kRelaxed);
    answer.word.store(word, std::memory_order_release);
}

std::optional<std::string> StatusPage::control_path() const {
    char path[abi::kControlPathBytes];
    if (!read_control(offsetof(abi::ControlPage, path), path, sizeof path)) return std::nullopt;
    const std::size_t length = strnlen(path, sizeof path);
    if (length == 0 || length == sizeof path) return std::nullopt;
    return std::string(path, length);
}

void StatusPage::tell(std::uint32_t word, const std::string& text) {
    header_->text_word.exchange(0, std::memory_order_acq_rel);  // before what comes is seen
    copy_name(header_->text, text);
    header_->text_word.store(word, std::memory_order_release);
}

void StatusPage::describe(std::size_t index, const config::Chain& now) {
    abi::ChainStatus& chain = chains_[index];
    chain.period_ns.store(now.period.count(), kRelaxed);
    chain.deadline_ns.store(now.deadline.count(), kRelaxed);
    chain.mode.store(to_status(now.mode), kRelaxed);
}

void StatusPage::allow(std::size_t chain, config::Mode mode) {
    chains_[chain].allowed_mode.store(static_cast<std::uint32_t>(to_status(mode)) + 1, kRelaxed);
}

bool StatusPage::wait_for_control(std::uint32_t seen) const {
    if (!control_) return false;
    // Not private: a process that writes the word maps the file elsewhere.
    const long result = syscall(SYS_futex, &control_->word, FUTEX_WAIT, seen, nullptr, nullptr, 0);
    return result == 0 || errno == EAGAIN || errno == EINTR;
}

}  // namespace urgengo::observe
