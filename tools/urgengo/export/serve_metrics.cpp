// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/export/serve_metrics.h"

#include <fmt/format.h>
#include <netdb.h>
#include <prometheus/exposer.h>
#include <prometheus/text_serializer.h>
#include <sys/socket.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <memory>
#include <string>

#include "host/base/file_descriptor.h"
#include "tools/urgengo/exit_codes.h"
#include "tools/urgengo/export/page_collector.h"

namespace urgengo::cli {
namespace {

/// @returns why no socket can listen there; empty if one can
std::string why_not(const ListenAddress& address) {
    addrinfo hints{};
    hints.ai_flags = AI_PASSIVE | AI_NUMERICHOST;
    hints.ai_socktype = SOCK_STREAM;
    addrinfo* found = nullptr;
    if (const int error = getaddrinfo(address.host.c_str(), address.port.c_str(), &hints, &found);
        error != 0)
        return gai_strerror(error);
    const std::unique_ptr<addrinfo, void (*)(addrinfo*)> owner(found, freeaddrinfo);
    const FileDescriptor socket(::socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC, 0));
    const int on = 1;
    setsockopt(socket.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    // It does not listen: a scraper that comes now would be let in, and find nothing.
    const bool is_free = bind(socket.get(), found->ai_addr, found->ai_addrlen) == 0;
    return is_free ? "" : std::strerror(errno);
}

}  // namespace

int serve_metrics(const ExportOptions& options) {
    const std::string folder = page_folder();
    if (folder.empty()) return fail(kExitUsage, "export: URGENGO_SHARE is 0: there are no pages");
    // Pages of processes that have become other programs are removed once, as by `top`.
    const auto pages = choose_pages(folder, options.pid, true, true);
    if (!pages) return fail(kExitFailure, pages.error());
    const auto collector = std::make_shared<PageCollector>(folder, options.pid);
    if (options.once) {
        fmt::print("{}", prometheus::TextSerializer().Serialize(collector->Collect()));
        return 0;
    }
    const auto address = parse_address(options.listen);
    if (!address) return fail(kExitUsage, address.error());
    if (const std::string reason = why_not(*address); !reason.empty())
        return fail(kExitFailure, fmt::format("cannot listen on {}: {}", options.listen, reason));

    // Before any thread is there, so that all of them leave the signals to this one.
    sigset_t ends;
    sigemptyset(&ends);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&ends, signal);
    pthread_sigmask(SIG_BLOCK, &ends, nullptr);
    std::signal(SIGPIPE, SIG_IGN);  // a scraper that goes away

    collector->follow();
    prometheus::Exposer exposer(fmt::format("{}:{}", address->host_in_url(), address->port));
    exposer.RegisterCollectable(collector);
    const std::vector<int> ports = exposer.GetListeningPorts();
    if (!options.quiet)
        tools::log_info("serves http://{}:{}/metrics", address->host_in_url(),
                        ports.empty() ? address->port : std::to_string(ports.front()));
    int signal = 0;
    sigwait(&ends, &signal);
    return 0;
}

}  // namespace urgengo::cli
