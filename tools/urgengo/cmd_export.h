// SPDX-License-Identifier: Apache-2.0
//
// urgengo export: metrics of processes under UrgenGo, for Prometheus. Hands over to urgengo-export,
// which lies beside this program and reads the same options (tools/urgengo/export).
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "host/base/result.h"

namespace urgengo::cli {

inline constexpr char kDefaultListen[] = "127.0.0.1:9865";

struct ExportOptions {
    std::string listen{kDefaultListen};
    std::uint32_t pid = 0;  ///< 0: all that this user may look at
    bool once = false;
    bool quiet = false;
};

struct ListenAddress {
    std::string host;  ///< a number, IPv4 or IPv6
    std::string port;

    std::string host_in_url() const {
        return host.find(':') == std::string::npos ? host : "[" + host + "]";
    }
};
/// @param text  "127.0.0.1:9865", "[::1]:9865", ":9865" (all addresses)
Result<ListenAddress> parse_address(const std::string& text);

CLI::App* add_export(CLI::App& app, ExportOptions& options);

/// @param arguments  all of the program's own
/// @returns an exit status if urgengo-export cannot be started; else it does not return
int cmd_export(const ExportOptions& options, const std::vector<std::string>& arguments);

}  // namespace urgengo::cli
