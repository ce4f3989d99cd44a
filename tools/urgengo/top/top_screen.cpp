// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/top/top_screen.h"

#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <clocale>
#include <cstdio>
#include <string_view>
#include <utility>

#include "host/base/clock.h"

// Functions instead of macros, which are names of others' functions, too.
#define NCURSES_NOMACROS 1
#include <curses.h>

namespace urgengo::cli {
namespace {

constexpr int kEscape = 27;

struct Key {
    const char* key;
    const char* meaning;
};
constexpr Key kKeys[] = {{"q", "quit"},
                         {"s", "sort by the next of urgency, name, missed, p99, held"},
                         {"r", "reverse"},
                         {"t", "tasks of the chains"},
                         {"/", "filter chains by name; an empty name ends that"},
                         {"p", "pause"},
                         {"up, down, page", "scroll"},
                         {"h", "this help"}};

std::atomic<int> g_signal{0};

void note_signal(int number) {
    g_signal.store(number);
}

/// The terminal in curses' hands for as long as the object lives, and signals that would end the
/// program without giving it back noted instead.
class Terminal {
  public:
    Terminal() {
        std::setlocale(LC_ALL, "");
        screen_ = newterm(nullptr, stdout, stdin);
        if (!screen_) return;
        set_term(screen_);
        struct sigaction action {};
        action.sa_handler = note_signal;
        sigemptyset(&action.sa_mask);
        for (std::size_t i = 0; i < std::size(kSignals); ++i)
            sigaction(kSignals[i], &action, &before_[i]);
        cbreak();
        noecho();
        keypad(stdscr, TRUE);
        curs_set(0);
        if (has_colors()) {
            start_color();
            use_default_colors();
            init_pair(1, COLOR_RED, -1);
            init_pair(2, COLOR_YELLOW, -1);
            init_pair(3, COLOR_CYAN, -1);
        }
    }
    ~Terminal() {
        if (!screen_) return;
        curs_set(1);
        endwin();
        delscreen(screen_);
        for (std::size_t i = 0; i < std::size(kSignals); ++i)
            sigaction(kSignals[i], &before_[i], nullptr);
    }
    Terminal(const Terminal&) = delete;
    Terminal& operator=(const Terminal&) = delete;
    bool is_there() const { return screen_ != nullptr; }

  private:
    static constexpr int kSignals[] = {SIGINT, SIGTERM, SIGHUP, SIGQUIT};
    SCREEN* screen_ = nullptr;
    struct sigaction before_[std::size(kSignals)] = {};
};

attr_t look_of(TopLine::Look look) {
    const auto color = [](short pair) {
        return has_colors() ? static_cast<attr_t>(COLOR_PAIR(pair)) : A_NORMAL;
    };
    switch (look) {
        case TopLine::Look::kHead:
            return A_REVERSE;
        case TopLine::Look::kProcess:
            return A_BOLD | color(3);
        case TopLine::Look::kLate:
            return A_BOLD | color(1);
        case TopLine::Look::kHeld:
            return color(2);
        case TopLine::Look::kIdle:
        case TopLine::Look::kTask:
            return A_DIM;
        case TopLine::Look::kPlain:
            break;
    }
    return A_NORMAL;
}

class Screen {
  public:
    Screen(TopOptions options, double interval_s) : options_(std::move(options)) {
        interval_ = std::chrono::milliseconds(static_cast<std::int64_t>(interval_s * 1e3));
    }

    void run(const std::function<std::vector<PageReading>()>& look) {
        nanoseconds next_look{0};
        while (!is_over_ && g_signal.load() == 0) {
            const nanoseconds now = monotonic_now();
            if (now >= next_look) {
                if (!is_paused_) pages_ = look();
                next_look = now + interval_;
            }
            draw();
            const auto left =
                std::chrono::duration_cast<std::chrono::milliseconds>(next_look - monotonic_now());
            timeout(static_cast<int>(std::clamp<std::int64_t>(left.count(), 1, 200)));
            take_key(getch());
        }
    }

  private:
    void put(int row, const std::string& text, attr_t look) const {
        attrset(static_cast<int>(look));
        // A later version's, or a program's, names may hold anything.
        std::string shown = text.substr(0, static_cast<std::size_t>(std::max(COLS, 0)));
        std::replace_if(
            shown.begin(), shown.end(),
            [](char c) { return static_cast<unsigned char>(c) < ' ' || c == 127; }, '?');
        mvaddnstr(row, 0, shown.c_str(), COLS);
        if (look == A_REVERSE && static_cast<int>(shown.size()) < COLS)
            hline(' ' | static_cast<chtype>(A_REVERSE), COLS - static_cast<int>(shown.size()));
        attrset(A_NORMAL);
    }

    void draw() {
        erase();
        if (shows_help_)
            draw_help();
        else
            draw_lines();
        put(LINES - 1, foot(), A_REVERSE);
        refresh();
    }

    std::string foot() const {
        if (is_filtering_) return "filter: " + options_.filter + "_";
        std::string text = fmt::format(" h help  q quit  sort: {}{}", to_word(options_.order),
                                       options_.reverse ? ", reversed" : "");
        if (!options_.filter.empty()) text += "  filter: " + options_.filter;
        if (is_paused_) text += "  PAUSED";
        return text;
    }

    void draw_help() const {
        int row = 0;
        put(row++, "urgengo top", A_BOLD);
        for (const Key& key : kKeys)
            put(++row, fmt::format("  {:<16} {}", key.key, key.meaning), A_NORMAL);
        row += 2;
        put(row++, "  a wider terminal shows more columns", A_NORMAL);
        put(row++, "  red: late   yellow: held   dim: works on no frame", A_NORMAL);
        put(row, "  laxity: ms to the deadline, less all that the frame still needs", A_NORMAL);
    }

    void draw_lines() {
        const std::vector<TopLine> lines = top_lines(pages_, options_);
        const std::vector<std::size_t> widths = top_widths(lines);
        const std::vector<TopColumn> shown =
            columns_that_fit(widths, static_cast<std::size_t>(std::max(COLS, 0)));
        const int room = std::max(LINES - 2, 0);
        const int most = std::max(static_cast<int>(lines.size()) - 1 - room, 0);
        first_ = std::clamp(first_, 0, most);
        put(0, top_text(lines[0], widths, shown), look_of(lines[0].look));
        if (pages_.empty()) put(1, "no process under UrgenGo", A_NORMAL);
        for (int row = 0; row < room && first_ + row + 1 < static_cast<int>(lines.size()); ++row) {
            const TopLine& line = lines[static_cast<std::size_t>(first_ + row + 1)];
            put(row + 1, top_text(line, widths, shown), look_of(line.look));
        }
    }

    void take_key(int key) {
        if (key == ERR || key == KEY_RESIZE) return;
        if (is_filtering_) return take_letter(key);
        if (std::exchange(shows_help_, false)) return;
        switch (key) {
            case 'q':
                is_over_ = true;
                break;
            case 's':
                options_.order = next(options_.order);
                break;
            case 'r':
                options_.reverse = !options_.reverse;
                break;
            case 't':
                options_.tasks = !options_.tasks;
                break;
            case 'p':
            case ' ':
                is_paused_ = !is_paused_;
                break;
            case '/':
                is_filtering_ = true;
                options_.filter.clear();
                break;
            case 'h':
            case '?':
            case KEY_F(1):
                shows_help_ = true;
                break;
            case KEY_UP:
                --first_;
                break;
            case KEY_DOWN:
                ++first_;
                break;
            case KEY_PPAGE:
                first_ -= LINES - 2;
                break;
            case KEY_NPAGE:
                first_ += LINES - 2;
                break;
            default:
                break;
        }
    }

    void take_letter(int key) {
        if (key == '\n' || key == KEY_ENTER || key == kEscape) {
            is_filtering_ = false;
        } else if (key == KEY_BACKSPACE || key == 127 || key == '\b') {
            if (!options_.filter.empty()) options_.filter.pop_back();
        } else if (key >= ' ' && key < 256) {
            options_.filter += static_cast<char>(key);
        }
    }

    TopOptions options_;
    std::chrono::milliseconds interval_;
    std::vector<PageReading> pages_;
    int first_ = 0;  // of the lines below the head
    bool is_over_ = false, is_paused_ = false, shows_help_ = false, is_filtering_ = false;
};

}  // namespace

std::string top_keys() {
    std::string keys;
    for (const Key& key : kKeys)
        keys += fmt::format("{}{} {}", keys.empty() ? "" : "; ", key.key, key.meaning);
    return keys;
}

Result<bool> show_top(TopOptions options, double interval_s,
                      const std::function<std::vector<PageReading>()>& look) {
    const Terminal terminal;
    if (!terminal.is_there())
        return Error{"top: the terminal cannot be used (TERM), accepted: another one, or --once"};
    Screen(std::move(options), interval_s).run(look);
    return true;
}

}  // namespace urgengo::cli
