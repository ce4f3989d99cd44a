# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt: the benches.
if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_bench_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_bench_effects.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_bench_floor.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_bench_plan.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_bench_runs.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_cmd_sim.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_equal_chains.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_html_report.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_html_template.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_instance_match.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_instance_records.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_instances_report.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_latency_merge.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_overhead_bench.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_own_time_histogram.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_throughput_bench.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_tool_log.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_tracking_bench.cpp"
    LINK urgengo::benches urgengo::commands)
  urgengo_unite(urgengo_bench_tests)
  target_compile_definitions(urgengo_bench_tests PRIVATE
    URGENGO_SIM_DATA="${CMAKE_SOURCE_DIR}/tools/sim/data"
    URGENGO_CHAINS_FOLDER="${CMAKE_SOURCE_DIR}/tools/chains")
endif()
