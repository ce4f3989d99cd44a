// SPDX-License-Identifier: Apache-2.0
#include "host/exec/published_copies.h"

#include <functional>
#include <map>

#include "tests/support/catch.h"

using namespace urgengo;
using namespace std::chrono_literals;
using exec::PublishedCopies;
using std::chrono::nanoseconds;

namespace {

const exec::MarkContext kContext, kAnother;
CUevent event(std::uintptr_t number) {
    return reinterpret_cast<CUevent>(number);
}

/// One task's copies, of 100 us each, and the driver's answers.
struct Published {
    PublishedCopies copies;
    nanoseconds now = 1s;
    std::map<CUevent, CUresult> answers;  ///< CUDA_ERROR_NOT_READY else
    int num_asked = 0;
    std::function<void()> after_ask = [] {};

    auto ask() {
        return [this](CUevent e) {
            ++num_asked;
            const auto answer = answers.find(e);
            const CUresult result = answer == answers.end() ? CUDA_ERROR_NOT_READY : answer->second;
            after_ask();
            return result;
        };
    }
    PublishedCopies::Place take() { return copies.take_place(now, &kContext, ask()); }
    PublishedCopies::Ticket add(CUevent end, CUevent reached = nullptr) {
        return copies.submitted(take(), {&kContext, reached, end}, now, 100us);
    }
    bool are_at_engine(const exec::MarkContext* context = &kContext) {
        const bool are = copies.are_at_engine(now, context, ask());
        CHECK((!are || copies.may_be_any(now)));
        return are;
    }
};

}  // namespace

TEST_CASE("Copy is at the engine from when it comes until it is seen over, for a bound",
          "[runtime][copies]") {
    Published p;
    CHECK_FALSE(p.are_at_engine());
    p.copies.comes(p.now + 1ms);
    CHECK(p.are_at_engine());
    p.copies.nothing_came();
    CHECK_FALSE(p.are_at_engine());
    p.copies.comes(p.now + 1ms);
    p.add(event(1));
    CHECK(p.are_at_engine());
    p.answers[event(1)] = CUDA_SUCCESS;
    CHECK_FALSE(p.are_at_engine());
    p.num_asked = 0;
    CHECK_FALSE(p.are_at_engine());  // for good
    CHECK_FALSE(p.copies.may_be_any(p.now));
    CHECK(p.num_asked == 0);

    p.add(event(2));
    p.now += 2ms + 199us;
    CHECK(p.are_at_engine());
    p.now += 1us;
    CHECK_FALSE(p.are_at_engine());
    CHECK_FALSE(p.copies.may_be_any(p.now));
}

TEST_CASE("Copies are at the engine when the one at hand ends while it is asked about them",
          "[runtime][copies]") {
    Published p;
    for (std::uintptr_t i = 1; i <= 2; ++i) p.copies.over(p.add(event(i)), false);
    p.add(event(3));
    p.add(event(5), event(4));  // behind it, and in the first place
    p.after_ask = [&] { p.answers[event(3)] = p.answers[event(4)] = CUDA_SUCCESS; };
    CHECK(p.are_at_engine());
    CHECK(p.are_at_engine());
    p.answers[event(5)] = CUDA_SUCCESS;
    CHECK_FALSE(p.are_at_engine());
}

TEST_CASE("Copy is not at the engine before its stream has reached it", "[runtime][copies]") {
    Published p;
    p.add(event(2), event(1));
    CHECK_FALSE(p.are_at_engine());
    p.now += 1s;
    CHECK_FALSE(p.are_at_engine());
    p.answers[event(1)] = CUDA_SUCCESS;
    CHECK(p.are_at_engine());
    p.now += 2ms + 199us;  // from when it was seen reached
    CHECK(p.are_at_engine());
    p.now += 1us;
    CHECK_FALSE(p.are_at_engine());
}

TEST_CASE("Copy counts for its time where events cannot tell", "[runtime][copies]") {
    Published p;
    const int how = GENERATE(range(0, 4));
    const bool none = how == 0;
    p.copies.submitted(p.take(), {none ? nullptr : &kContext, nullptr, none ? nullptr : event(1)},
                       p.now, 100us);
    if (how == 1) p.answers[event(1)] = CUDA_ERROR_INVALID_HANDLE;
    const auto* context = how == 2 ? &kAnother : how == 3 ? nullptr : &kContext;
    p.now += 99us;
    CHECK(p.are_at_engine(context));
    p.now += 1us;
    CHECK_FALSE(p.are_at_engine(context));
    CHECK((how == 1 || p.num_asked == 0));
}

TEST_CASE("Slices of one copy go on in its place", "[runtime][copies]") {
    Published p;
    auto place = p.take();
    p.copies.submitted(place, {&kContext, event(1), event(2)}, p.now, 100us);
    place.is_shared = true;
    p.answers[event(1)] = CUDA_SUCCESS;
    CHECK(p.are_at_engine());
    p.now += 2ms;
    p.copies.submitted(place, {&kContext, event(1), event(3)}, p.now, 100us);
    p.answers[event(2)] = CUDA_SUCCESS;
    CHECK(p.are_at_engine());
    p.now += 2ms;  // the bound begins with each slice
    CHECK(p.are_at_engine());
    p.answers[event(3)] = CUDA_SUCCESS;
    CHECK_FALSE(p.are_at_engine());
    p.copies.submitted(place, {&kContext, event(1), event(4)}, p.now, 100us);
    CHECK(p.are_at_engine());
}

TEST_CASE("Copies that are not over keep their places, and more are taken for one",
          "[runtime][copies]") {
    Published p;
    for (std::uintptr_t i = 1; i <= PublishedCopies::kPlaces; ++i)
        CHECK_FALSE(p.add(event(10 + i), event(i)).version == 0);
    CHECK(p.take().is_shared);
    p.add(event(20));
    CHECK_FALSE(p.are_at_engine());
    p.answers[event(4)] = CUDA_SUCCESS;
    p.answers[event(14)] = CUDA_SUCCESS;
    CHECK(p.are_at_engine());
    p.answers[event(20)] = CUDA_SUCCESS;
    CHECK_FALSE(p.are_at_engine());
    const auto place = p.take();
    CHECK(place.index == 0);
    CHECK_FALSE(place.is_shared);
    // Nobody has looked, but one of them is over.
    p.copies.submitted(place, {&kContext, nullptr, event(21)}, p.now, 100us);
    p.answers[event(12)] = CUDA_SUCCESS;
    CHECK(p.take().index == 2);
}

TEST_CASE("Wait of the program ends a copy unless it has gone on, and of the context all before",
          "[runtime][copies]") {
    Published p;
    const auto first = p.add(event(1));
    auto place = p.take();
    const auto second = p.copies.submitted(place, {&kContext, nullptr, event(2)}, p.now, 100us);
    place.is_shared = true;
    SECTION("one stream's") {
        p.copies.over(first, false);
        CHECK(p.are_at_engine());
        p.copies.over(second, false);
        CHECK_FALSE(p.are_at_engine());
    }
    SECTION("the context's") {
        p.copies.over(second, true);
        CHECK_FALSE(p.are_at_engine());
    }
    SECTION("and then a slice more") {
        p.copies.submitted(place, {&kContext, nullptr, event(3)}, p.now, 100us);
        p.copies.over(second, true);
        p.answers[event(1)] = CUDA_SUCCESS;
        CHECK(p.are_at_engine());
    }
    SECTION("an event that is used again") {
        p.copies.seen(event(1));
        p.copies.seen(event(2));
        CHECK_FALSE(p.are_at_engine());
    }
}

TEST_CASE("Answer counts only for the copy that was asked about", "[runtime][copies]") {
    Published p;
    auto place = p.take();
    p.copies.submitted(place, {&kContext, nullptr, event(1)}, p.now, 100us);
    place.is_shared = true;
    // A slice is published while the driver answers that the one before it is over.
    const auto ask = [&](CUevent) {
        p.copies.submitted(place, {&kContext, nullptr, event(2)}, p.now, 100us);
        return CUDA_SUCCESS;
    };
    CHECK(p.copies.are_at_engine(p.now, &kContext, ask));
    CHECK(p.are_at_engine());
}
