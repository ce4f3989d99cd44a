// SPDX-License-Identifier: Apache-2.0
#include "tools/chains/stamps_file.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <span>

namespace urgengo::chains {

namespace {

using Json = nlohmann::ordered_json;

template <typename Element>
void append(std::string& data, Json& arrays, const std::string& name, const char* fields,
            const std::vector<Element>& elements) {
    const auto bytes = std::as_bytes(std::span(elements));
    arrays.push_back({{"name", name},
                      {"count", elements.size()},
                      {"bytes", sizeof(Element)},
                      {"fields", fields}});
    data.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
}

std::uint64_t num_launches(const StampsFile& file) {
    std::uint64_t sum = 0;
    for (const StampedStream& stream : file.streams) sum += stream.launches;
    return sum;
}

std::uint64_t num_stamps(const StampsFile& file) {
    std::uint64_t sum = 0;
    for (const StampedStream& stream : file.streams) sum += stream.stamps.size();
    return sum;
}

}  // namespace

std::string format_stamps(const StampsFile& file) {
    Json json = {{"format_version", kStampsFormatVersion},
                 {"gpu", file.gpu},
                 {"urgengo", file.urgengo},
                 {"command", file.command_line},
                 {"clock", Json::array()},
                 {"streams", Json::array()},
                 {"sampler",
                  {{"mean_us", file.sample_mean_us},
                   {"seed", file.sample_seed},
                   {"wakes", file.sampler.wakes},
                   {"lost", file.sampler.lost},
                   {"changed", file.sampler.changed},
                   {"cpu_s", file.sampler.cpu_s},
                   {"wall_s", file.sampler.wall_s}}},
                 {"arrays", Json::array()}};
    for (const ClockReading& reading : file.clock) {
        json["clock"].push_back({{"host_ns", reading.host_ns},
                                 {"gpu_ns", reading.gpu_ns},
                                 {"bound_ns", reading.bound_ns},
                                 {"round_trips", reading.round_trips}});
    }
    std::string data;
    for (const StampedStream& stream : file.streams) {
        json["streams"].push_back({{"chain", stream.chain},
                                   {"tasks", stream.tasks},
                                   {"launches", stream.launches},
                                   {"lost", stream.launches - stream.stamps.size()}});
        append(data, json["arrays"], "stamps", "QQ", stream.stamps);
        append(data, json["arrays"], "runs", "IIII", stream.runs);
    }
    append(data, json["arrays"], "samples", "qIHHIIIIqqq", file.samples);
    return json.dump() + "\n" + data;
}

std::string describe_stamps(const StampsFile& file) {
    const std::uint64_t launches = num_launches(file), lost = launches - num_stamps(file);
    std::string text =
        fmt::format("Stamps of {} launches{}; {} positions", launches,
                    lost ? fmt::format(", NONE of {} of them", lost) : "", file.samples.size());
    if (file.sampler.lost) text += fmt::format(", NO ROOM for {} more", file.sampler.lost);
    if (file.sampler.wall_s > 0)
        text += fmt::format(", asked for in {:.2f} % of a core",
                            100 * file.sampler.cpu_s / file.sampler.wall_s);
    for (const ClockReading& reading : file.clock)
        text += fmt::format("{}{:.2f} us",
                            &reading == &file.clock.front() ? "; clocks within " : " and ",
                            static_cast<double>(reading.bound_ns) / 1000);
    return text + "\n";
}

}  // namespace urgengo::chains
