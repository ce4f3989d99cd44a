# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt: the simulator's models.
if(TARGET urgengo_sim)
  urgengo_add_tests(urgengo_sim_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_chains.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_cpu.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_gates.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_gpu.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_least_misses.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_parking.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_properties.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_recorded.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_streams.cpp"
            "${CMAKE_SOURCE_DIR}/tests/support/simulated_chains.cpp"
    LINK urgengo_sim)
  urgengo_add_tests(urgengo_sim_preset_tests LABEL unit TIMEOUT 600
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_sim_presets.cpp"
    LINK urgengo_sim nlohmann_json::nlohmann_json)
  target_compile_definitions(urgengo_sim_preset_tests PRIVATE
    SIM_MISSES="${CMAKE_SOURCE_DIR}/tests/unit/data/sim_misses.json")
endif()
