// SPDX-License-Identifier: Apache-2.0
#include "tools/urgengo/page/page_reader.h"

#include <unistd.h>

#include <cstring>
#include <fstream>
#include <random>

#include "host/observe/status_page.h"
#include "tests/support/catch.h"
#include "tests/support/folder.h"
#include "tests/support/lidar_and_camera.h"
#include "tools/trace/clean_text.h"
#include "tools/urgengo/top/top_view.h"

using namespace urgengo;
using namespace std::chrono_literals;
using cli::parse_page;
using cli::read_page;
using std::chrono::nanoseconds;
using Folder = testing::MemoryFolder;

namespace {

config::Config two_chains() {
    return testing::lidar_and_camera(80ms, 50ms, {{"detect", ""}, {"track", ""}});
}

struct Fixture {
    Folder folder;
    observe::StatusPage page{{folder.path().string(), ""}, two_chains(), 1s};

    std::vector<std::byte> bytes() const {
        std::ifstream file(page.stem() + observe::kPageSuffix, std::ios::binary);
        const std::string text{std::istreambuf_iterator<char>(file), {}};
        std::vector<std::byte> bytes(text.size());
        std::memcpy(bytes.data(), text.data(), text.size());
        return bytes;
    }
    /// The camera's frames end one second after each other.
    void end_frame(int number, nanoseconds latency) {
        abi::ChainStatus& chain = page.chain(1);
        abi::FrameRecord& frame = chain.ring[number % abi::kFrameRing];
        frame.end_ns = std::chrono::nanoseconds(std::chrono::seconds(number)).count();
        frame.latency_us = static_cast<std::uint32_t>(latency / 1us);
        frame.cause = latency > 50ms ? static_cast<std::uint16_t>(abi::MissCause::kHeld) : 0;
        chain.frames = static_cast<std::uint64_t>(number) + 1;
    }
};

void put(std::vector<std::byte>& bytes, std::size_t at, auto value) {
    std::memcpy(bytes.data() + at, &value, sizeof value);
}

}  // namespace

TEST_CASE("Page reader tells what the page tells", "[cli][page]") {
    Fixture f;
    f.page.set_mode(config::Mode::kObserve);
    f.page.chain(1).missed = 3;
    f.page.chain(1).causes[static_cast<std::size_t>(abi::MissCause::kHeld)] = 2;
    f.page.chain(1).last_miss = 7;
    f.page.chain(1).last_behind = 0;
    const auto page = read_page(f.page.stem(), 2s);
    REQUIRE(page);
    CHECK(page->liveness == observe::Liveness::kThere);
    CHECK(page->process.process == static_cast<std::uint32_t>(getpid()));
    CHECK(page->mode == abi::StatusMode::kObserve);
    CHECK(page->began == 1s);
    REQUIRE(page->chains.size() == 2);
    CHECK(page->chains[1].name == "camera");
    CHECK(page->chains[1].deadline == 50ms);
    CHECK(page->chains[1].missed == 3);
    CHECK(page->chains[1].tasks == std::vector<std::size_t>{2, 3});
    CHECK(page->chains[1].causes[static_cast<std::size_t>(abi::MissCause::kHeld)] == 2);
    CHECK(page->chains[1].last_miss.number == 7);
    CHECK(page->chains[1].last_miss.behind == 0);
    CHECK(page->chains[1].at == -1);
    CHECK(page->tasks[3].name == "track");
    CHECK(page->tasks[3].chain == 1);
}

TEST_CASE("Page reader tells who waits behind whom, with how much laxity", "[cli][page]") {
    Fixture f;
    constexpr std::int64_t kNow = 10'000'000'000;
    abi::TaskSlot& front = f.page.akb().tasks[0];
    abi::TaskSlot& held = f.page.akb().tasks[2];
    for (abi::TaskSlot* slot : {&front, &held}) {
        slot->deadline_ns = kNow + 30'000'000;
        slot->head_remaining_ns = 10'000'000;
        slot->look_ns = slot->launch_ns = slot->progress_ns = kNow;
    }
    front.state = abi::TaskState::kGpu;
    held.state = abi::TaskState::kHeld;
    held.queue_why = abi::Why::kRank;
    held.queue_behind = 0;
    held.queue_since_ns = kNow - 4'000'000;
    const auto page = read_page(f.page.stem(), nanoseconds(kNow));
    REQUIRE(page);
    CHECK(page->held_now == 1);
    CHECK(page->chains[0].at == 0);
    CHECK(page->chains[1].at == 2);
    CHECK(page->tasks[2].behind == 0);
    CHECK(page->tasks[2].why == abi::Why::kRank);
    CHECK(page->tasks[2].held == 4ms);
    CHECK(page->tasks[2].remaining_gpu == 10ms);
    CHECK(page->tasks[2].laxity == 20ms);
}

TEST_CASE("Page reader tells which kernel of its plan a task is at", "[cli][page]") {
    const Folder folder;
    config::Profile profile;
    profile.chains = {{"lidar", {{}, {}}}};
    config::TaskProfile& detect = profile.chains[0].tasks[0];
    detect.name = "detect";
    for (const auto& [name, time] : {std::pair{"first", 2ms}, std::pair{"second", 5ms},
                                     std::pair{"first", 1ms}, std::pair{"last", 2ms}})
        detect.kernels.push_back({name, 100, 256, time, 1.0});
    const observe::ShareOptions share{folder.path().string(), ""};
    observe::StatusPage status(share, two_chains(), 1s, &profile);
    REQUIRE(status.header().launches.count == 4);
    REQUIRE(status.header().kernel_names.count == 3);
    status.task(0).num_kernels = 4;
    status.task(0).priority = -3;
    constexpr std::int64_t kNow = 10'000'000'000;
    abi::TaskSlot& slot = status.akb().tasks[0];
    slot.state = abi::TaskState::kGpu;
    slot.deadline_ns = kNow + 30'000'000;
    slot.launch_ns = slot.progress_ns = kNow;
    const bool is_corrected = GENERATE(false, true);
    if (is_corrected) slot.factor_ppm = 1'237'000;  // the plan's times stay what they are
    const auto at = [&](std::chrono::nanoseconds left) {
        slot.head_remaining_ns = left.count();
        const auto page = read_page(status.stem(), nanoseconds(kNow));
        REQUIRE(page);
        return std::pair{page->tasks[0].kernel, page->tasks[0].kernel_name};
    };
    using At = std::pair<std::uint32_t, std::string>;
    CHECK(at(10ms) == At{1, "first"});
    CHECK(at(9ms) == At{1, "first"});
    CHECK(at(8ms) == At{2, "second"});
    CHECK(at(3ms + 1us) == At{2, "second"});
    CHECK(at(3ms) == At{3, "first"});
    CHECK(at(2ms) == At{4, "last"});
    CHECK(at(0ms) == At{4, "last"});
    CHECK(at(1h) == At{1, "first"});  // more than is planned
    const auto page = read_page(status.stem(), nanoseconds(kNow));
    REQUIRE(page);
    CHECK(page->tasks[0].priority == -3);
    CHECK(page->tasks[0].factor == (is_corrected ? Approx(1.237) : Approx(1)));
    CHECK(page->tasks[1].kernel == 0);  // works on nothing, and has no plan
    slot.state = abi::TaskState::kIdle;
    CHECK(at(3ms) == At{0, ""});
}

TEST_CASE("List of kernels that does not fit is none", "[cli][page]") {
    Fixture f;
    abi::TaskSlot& slot = f.page.akb().tasks[0];
    slot.state = abi::TaskState::kGpu;
    f.page.task(0).num_kernels = 3;
    f.page.task(0).first_launch = GENERATE(1u, 2u, 1000u, ~0u);
    const std::vector<std::byte> good = f.bytes();
    const std::uint64_t inside = f.page.header().tasks.offset;
    for (const abi::StatusSection launches :
         {abi::StatusSection{inside, 8, 2}, abi::StatusSection{~0ull, 8, 1000},
          abi::StatusSection{inside, 4, 1000}, abi::StatusSection{0, ~0u, 2},
          abi::StatusSection{inside, 8, ~0u}}) {
        std::vector<std::byte> bytes = good;
        put(bytes, offsetof(abi::StatusHeader, launches), launches);
        put(bytes, offsetof(abi::StatusHeader, kernel_names), launches);
        const auto page = parse_page(bytes, 2s);
        REQUIRE(page);
        CHECK(page->tasks[0].kernel == 0);
    }
}

TEST_CASE("Page reader tells what the dispatcher does", "[cli][page]") {
    Fixture f;
    f.page.akb().tasks[0].gates_closed = 7;
    f.page.akb().tasks[0].gates_opened = 5;
    f.page.akb().tasks[0].gates_opened_by_gpu = 4;
    f.page.akb().tasks[2].gates_closed = f.page.akb().tasks[2].gates_opened = 3;
    f.page.akb().dispatch.gpu_rounds = 10;
    f.page.akb().dispatch.gpu_round_us = 120;
    f.page.akb().dispatch.gpu_urgent_laxity_ns = 3'000'000;
    f.page.akb().tasks[0].state = abi::TaskState::kGpu;
    for (int task : {0, 2}) f.page.akb().ranked[task] = abi::RankedWord{-5'000, 3}.pack();
    f.page.header().looks_ns = 5'000'000;
    const auto page = read_page(f.page.stem(), 2s);
    REQUIRE(page);
    CHECK(page->dispatcher.gates == 10);
    CHECK(page->dispatcher.urgent_laxity == 3ms);
    CHECK(page->tasks[0].rank == 3);
    CHECK(page->tasks[2].rank == 0);  // it is idle
    CHECK(page->dispatcher.closed == 2);
    CHECK(page->dispatcher.opened_by_gpu == 4);
    CHECK(page->dispatcher.gpu_rounds == 10);
    CHECK(page->dispatcher.gpu_round == 12us);
    CHECK(page->looks == 5ms);
}

TEST_CASE("Page reader counts the frames of the last minute, however often the ring went round",
          "[cli][page]") {
    Fixture f;
    const int frames = GENERATE(5, 30, 1000, 1024, 5000);
    for (int n = 0; n < frames; ++n) f.end_frame(n, n % 10 == 0 ? 60ms : 20ms);
    const auto page = read_page(f.page.stem(), std::chrono::seconds(frames - 1));
    REQUIRE(page);
    const auto& lately = page->chains[1].lately;
    CHECK(lately.frames == static_cast<std::size_t>(std::min(frames, 61)));
    CHECK(lately.median == 20ms);
    CHECK(lately.max == 60ms);
    CHECK(lately.missed == static_cast<std::size_t>(frames == 5 ? 1 : frames == 30 ? 3 : 6));
    CHECK(lately.p99 == 60ms);
    CHECK(page->chains[0].lately.frames == 0);
}

TEST_CASE("Frame of the last minute was late if it has a cause: its latency is cut to microseconds",
          "[cli][page]") {
    Fixture f;
    f.end_frame(0, 50ms);
    f.end_frame(1, 50ms + 400ns);
    const auto page = read_page(f.page.stem(), 2s);
    REQUIRE(page);
    CHECK(page->chains[1].lately.frames == 2);
    CHECK(page->chains[1].lately.missed == 1);
    CHECK(page->chains[1].lately.max == 50ms);
}

TEST_CASE("Slot that changes hands while it is read is shown idle", "[cli][page]") {
    Fixture f;
    for (const std::size_t i : {0u, 2u}) {
        abi::TaskSlot& slot = f.page.akb().tasks[i];
        slot.version = 4;
        slot.state = abi::TaskState::kHeld;
        slot.queue_why = abi::Why::kRank;
    }
    SECTION("since it was copied") {
        const std::size_t second = reinterpret_cast<std::byte*>(&f.page.akb().tasks[2]) -
                                   reinterpret_cast<std::byte*>(&f.page.header());
        const auto page = parse_page(f.bytes(), 2s, [&](std::size_t at) {
            return std::optional<std::uint32_t>(at == second ? 6 : 4);
        });
        REQUIRE(page);
        CHECK(page->tasks[0].state == abi::TaskState::kHeld);
        CHECK(page->tasks[2].state == abi::TaskState::kIdle);
        CHECK(page->tasks[2].why == abi::Why::kNone);
        CHECK(page->held_now == 1);
        CHECK(page->chains[1].at == -1);
    }
    SECTION("at the moment") {
        f.page.akb().tasks[2].version = 5;
        const auto page = read_page(f.page.stem(), 2s);
        REQUIRE(page);
        CHECK(page->tasks[0].state == abi::TaskState::kHeld);
        CHECK(page->tasks[2].state == abi::TaskState::kIdle);
        CHECK(page->chains[1].at == -1);
    }
}

TEST_CASE("Names are cleaned of what a terminal would obey, and of what is not UTF-8",
          "[cli][page]") {
    CHECK(trace::clean_text("l\u00efdar \u96f7\U0001f697~") == "l\u00efdar \u96f7\U0001f697~");
    CHECK(trace::clean_text("\x1b[2J\n\x7f") == "?[2J??");
    CHECK(trace::clean_text("a\u009b2Jb") == "a??2Jb");  // one character that begins a sequence
    CHECK(trace::clean_text("\x9b\xff\xc3") == "???");   // no characters
    CHECK(trace::clean_text("\xc0\x9b\xed\xa0\x80") ==
          "?????");  // more bytes than needed; half of one
    CHECK(trace::clean_text("\xe2\x82") == "??");
    Fixture f;
    std::strcpy(f.page.chain(0).name, "\x1b[31mlidar\xc3");
    std::strcpy(f.page.task(0).name, "\ttask");
    std::strcpy(f.page.header().program, "\x1b]0;title\x07");
    const auto page = read_page(f.page.stem(), 2s);
    REQUIRE(page);
    CHECK(page->chains[0].name == "?[31mlidar?");
    CHECK(page->tasks[0].name == "?task");
    CHECK(page->program == "?]0;title?");
    CHECK(cli::top_json({*page}).dump().find("?[31mlidar?") != std::string::npos);
}

TEST_CASE("Page of a later version is read as far as it is known", "[cli][page]") {
    Fixture f;
    std::vector<std::byte> old = f.bytes();
    abi::StatusHeader header;
    std::memcpy(static_cast<void*>(&header), old.data(), sizeof header);
    // Longer elements, at the end of the file.
    constexpr std::size_t kMore = 64;
    std::vector<std::byte> later = old;
    const std::size_t chains_at = later.size();
    const std::size_t element = sizeof(abi::ChainStatus) + kMore;
    later.resize(chains_at + 2 * element, std::byte{0xee});
    for (std::size_t i = 0; i < 2; ++i)
        std::memcpy(later.data() + chains_at + i * element,
                    old.data() + header.chains.offset + i * sizeof(abi::ChainStatus),
                    sizeof(abi::ChainStatus));
    put(later, offsetof(abi::StatusHeader, version), abi::kStatusVersion + 1);
    put(later, offsetof(abi::StatusHeader, chains),
        abi::StatusSection{chains_at, static_cast<std::uint32_t>(element), 2});
    const auto page = parse_page(later, 2s);
    REQUIRE(page);
    CHECK(page->version == abi::kStatusVersion + 1);
    CHECK(page->chains[0].name == "lidar");
    CHECK(page->chains[1].name == "camera");
    CHECK(page->chains[1].deadline == 50ms);

    SECTION("and of an earlier one, that lacks fields, they are 0") {
        constexpr std::size_t kKnown = offsetof(abi::ChainStatus, instances);
        f.page.chain(0).missed = 5;
        std::vector<std::byte> earlier = f.bytes();
        put(earlier, offsetof(abi::StatusHeader, chains),
            abi::StatusSection{header.chains.offset, kKnown, 1});
        put(earlier, offsetof(abi::StatusHeader, tasks),
            abi::StatusSection{header.tasks.offset, sizeof(abi::TaskStatus), 2});
        const auto read = parse_page(earlier, 2s);
        REQUIRE(read);
        CHECK(read->chains[0].name == "lidar");
        CHECK(read->chains[0].missed == 0);
        CHECK(read->tasks[0].priority == 0);
        put(earlier, offsetof(abi::StatusHeader, tasks),
            abi::StatusSection{header.tasks.offset, offsetof(abi::TaskStatus, priority), 2});
        put(earlier,
            header.tasks.offset + offsetof(abi::TaskStatus, priority) +
                offsetof(abi::TaskStatus, chain),
            std::uint32_t{0});
        const auto without = parse_page(earlier, 2s);
        REQUIRE(without);
        CHECK_FALSE(without->tasks[0].priority);
    }
}

TEST_CASE("Page reader refuses what does not fit, and is not led astray by any bytes",
          "[cli][page]") {
    const Fixture f;
    const std::vector<std::byte> good = f.bytes();
    REQUIRE(parse_page(good, 2s));
    const auto broken = [&](std::size_t at, auto value) {
        std::vector<std::byte> bytes = good;
        put(bytes, at, value);
        return parse_page(bytes, 2s);
    };
    CHECK_FALSE(broken(0, std::uint64_t{1}));
    CHECK_FALSE(broken(offsetof(abi::StatusHeader, header_bytes), std::uint32_t{1} << 31));
    CHECK_FALSE(broken(offsetof(abi::StatusHeader, chains) + 12, std::uint32_t{3000}));
    CHECK_FALSE(broken(offsetof(abi::StatusHeader, chains), ~std::uint64_t{0}));
    CHECK_FALSE(broken(offsetof(abi::StatusHeader, tasks) + 8, std::uint32_t{0}));
    CHECK_FALSE(broken(offsetof(abi::StatusHeader, akb), std::uint64_t{good.size()}));
    for (std::size_t length : {std::size_t{0}, std::size_t{100}, sizeof(abi::StatusHeader),
                               good.size() / 2, good.size() - abi::kSectionAlignment})
        CHECK_FALSE(parse_page({good.data(), length}, 2s));

    const std::uint32_t seed = std::random_device()();
    INFO("seed " << seed);
    std::mt19937 random(seed);
    for (int i = 0; i < 300; ++i) {
        std::vector<std::byte> bytes = good;
        // The headers and slots, which the rest is found by.
        for (int flips = 1 + static_cast<int>(random() % 40); flips > 0; --flips)
            bytes[random() % (random() % 2 == 0 ? sizeof(abi::StatusHeader) : bytes.size())] =
                static_cast<std::byte>(random());
        (void)parse_page(bytes, 2s);
    }
}

TEST_CASE("Times in a slot that cannot be true are cut before they are reckoned with",
          "[cli][page]") {
    constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
    constexpr std::int64_t kLeast = std::numeric_limits<std::int64_t>::min();
    Fixture f;
    abi::TaskSlot& slot = f.page.akb().tasks[0];
    slot.state = abi::TaskState::kGpu;
    slot.factor_ppm = ~std::uint32_t{0};
    const bool is_early = GENERATE(false, true);
    slot.head_remaining_ns = kMost;
    slot.launched_ns = kMost;
    slot.launched_at_mark_ns[0] = kLeast;
    slot.later_gpu_ns = kMost;
    slot.deadline_ns = is_early ? kLeast : kMost;
    slot.progress_ns = is_early ? kMost : kLeast;
    const auto page = read_page(f.page.stem(), 2s);
    REQUIRE(page);
    CHECK(page->tasks[0].remaining_gpu > 24h);
    CHECK(page->tasks[0].launched > 24h);
    CHECK(page->tasks[0].laxity < -24h);
}

TEST_CASE("Page reader says which file it could not read, and why", "[cli][page]") {
    const Folder folder;
    const auto missing = read_page(folder.path("none"), 0s);
    REQUIRE_FALSE(missing);
    CHECK(missing.error() == folder.path("none") + ".page: No such file or directory");
    std::filesystem::create_directory(folder.path("folder.page"));
    CHECK_FALSE(read_page(folder.path("folder"), 0s));
    std::filesystem::create_symlink("/etc/passwd", folder.path("link.page"));
    CHECK_FALSE(read_page(folder.path("link"), 0s));
}
