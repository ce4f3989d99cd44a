// SPDX-License-Identifier: Apache-2.0
//
// Perfetto's protobuf as far as exports of runs have it: tracks, events, clocks.
#pragma once

#include <cstdint>
#include <map>
#include <protozero/pbf_reader.hpp>
#include <string>
#include <vector>

#include "tests/support/catch.h"

namespace urgengo::testing {

/// What is read back of Perfetto's protobuf.
struct PerfettoTrace {
    struct Event {
        std::int64_t time_ns = 0;
        int type = 0;
        std::string name;
        double value = 0;
        std::vector<std::uint64_t> flows, last_flows;
        std::map<std::string, std::string> texts;
    };
    std::map<std::uint64_t, std::string> tracks;
    std::map<std::uint64_t, std::uint64_t> parents;
    std::size_t num_counters = 0;
    std::map<std::string, std::vector<Event>> events;            ///< by track
    std::map<std::uint32_t, std::vector<std::uint64_t>> clocks;  ///< by id, as they are snapped
    std::string process;
};

inline void read_descriptor(protozero::pbf_reader track, PerfettoTrace& read) {
    std::uint64_t uuid = 0, parent = 0;
    std::string name;
    while (track.next()) switch (track.tag()) {
            case 1:
                uuid = track.get_uint64();
                break;
            case 2:
                name = track.get_string();
                break;
            case 5:
                parent = track.get_uint64();
                break;
            case 8:
                ++read.num_counters;
                track.skip();
                break;
            case 3: {
                auto process = track.get_message();
                while (process.next(6)) read.process = process.get_string();
                break;
            }
            default:
                track.skip();
        }
    read.tracks[uuid] = name;
    read.parents[uuid] = parent;
}

inline void read_event(protozero::pbf_reader event, std::int64_t time_ns, PerfettoTrace& read) {
    PerfettoTrace::Event told;
    told.time_ns = time_ns;
    std::uint64_t track = 0;
    while (event.next()) switch (event.tag()) {
            case 4: {
                auto argument = event.get_message();
                std::string name, text;
                while (argument.next()) {
                    if (argument.tag() == 10)
                        name = argument.get_string();
                    else if (argument.tag() == 6)
                        text = argument.get_string();
                    else
                        argument.skip();
                }
                told.texts[name] = text;
                break;
            }
            case 9:
                told.type = event.get_enum();
                break;
            case 11:
                track = event.get_uint64();
                break;
            case 23:
                told.name = event.get_string();
                break;
            case 44:
                told.value = event.get_double();
                break;
            case 47:
                told.flows.push_back(event.get_fixed64());
                break;
            case 48:
                told.last_flows.push_back(event.get_fixed64());
                break;
            default:
                event.skip();
        }
    REQUIRE(read.tracks.count(track) == 1);  // it was described before
    const std::string& parent = read.tracks[read.parents[track]];
    read.events[(parent.empty() ? "" : parent + "/") + read.tracks[track]].push_back(told);
}

inline PerfettoTrace read_perfetto(const std::string& bytes) {
    PerfettoTrace read;
    protozero::pbf_reader trace(bytes);
    std::int64_t last_ns = 0;
    while (trace.next(1)) {
        auto packet = trace.get_message();
        std::int64_t time_ns = 0;
        std::uint32_t sequence = 0;
        protozero::pbf_reader event;
        while (packet.next()) switch (packet.tag()) {
                case 6: {
                    auto snapshot = packet.get_message();
                    while (snapshot.next(1)) {
                        auto clock = snapshot.get_message();
                        std::uint32_t id = 0;
                        while (clock.next())
                            if (clock.tag() == 1)
                                id = clock.get_uint32();
                            else
                                read.clocks[id].push_back(clock.get_uint64());
                    }
                    break;
                }
                case 8:
                    time_ns = static_cast<std::int64_t>(packet.get_uint64());
                    break;
                case 10:
                    sequence = packet.get_uint32();
                    break;
                case 11:
                    event = packet.get_message();
                    break;
                case 60:
                    read_descriptor(packet.get_message(), read);
                    break;
                default:
                    packet.skip();
            }
        CHECK(sequence == 1);
        if (event.data().empty()) continue;
        CHECK(time_ns >= last_ns);
        last_ns = time_ns;
        read_event(event, time_ns, read);
    }
    return read;
}

}  // namespace urgengo::testing
