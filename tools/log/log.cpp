// SPDX-License-Identifier: Apache-2.0
#include "tools/log/log.h"

#include <spdlog/logger.h>
#include <spdlog/pattern_formatter.h>
#include <spdlog/sinks/stdout_sinks.h>

#include <atomic>
#include <memory>
#include <string>

namespace urgengo::tools {
namespace {

std::atomic<void (*)()> g_before_line{nullptr};

/// The pattern's %*: a warning says that it is one. An error's text and the exit code say it.
class WarningFlag : public spdlog::custom_flag_formatter {
  public:
    void format(const spdlog::details::log_msg& message, const std::tm&,
                spdlog::memory_buf_t& line) override {
        constexpr std::string_view kWarning = "warning: ";
        if (message.level == spdlog::level::warn)
            line.append(kWarning.data(), kWarning.data() + kWarning.size());
    }
    std::unique_ptr<custom_flag_formatter> clone() const override {
        return std::make_unique<WarningFlag>();
    }
};

std::unique_ptr<spdlog::logger> make_logger(std::string_view name) {
    auto logger = std::make_unique<spdlog::logger>(
        std::string(name), std::make_shared<spdlog::sinks::stderr_sink_mt>());
    auto formatter = std::make_unique<spdlog::pattern_formatter>();
    formatter->add_flag<WarningFlag>('*').set_pattern("%n: %*%v");
    logger->set_formatter(std::move(formatter));
    return logger;
}

std::unique_ptr<spdlog::logger>& logger() {
    static auto the_logger = make_logger("urgengo");
    return the_logger;
}

spdlog::level::level_enum spdlog_level(LogLevel level) {
    switch (level) {
        case LogLevel::kDebug:
            return spdlog::level::debug;
        case LogLevel::kInfo:
            return spdlog::level::info;
        case LogLevel::kWarning:
            return spdlog::level::warn;
        case LogLevel::kError:
            break;
    }
    return spdlog::level::err;
}

}  // namespace

void set_log_name(std::string_view name) {
    const auto level = logger()->level();
    logger() = make_logger(name);
    logger()->set_level(level);
}

void set_log_level(LogLevel level) {
    logger()->set_level(spdlog_level(level));
}

bool says(LogLevel level) {
    return logger()->should_log(spdlog_level(level));
}

void set_before_line(void (*erase)()) {
    g_before_line.store(erase);
}

void log_at(LogLevel level, std::string_view text) {
    if (!says(level)) return;
    if (void (*const erase)() = g_before_line.load()) erase();
    logger()->log(spdlog_level(level), spdlog::string_view_t(text.data(), text.size()));
}

}  // namespace urgengo::tools
