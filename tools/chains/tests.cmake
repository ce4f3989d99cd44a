# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt: the workload program's pure parts.
if(TARGET urgengo_chains_core)
  urgengo_add_tests(urgengo_chains_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_arrivals.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_configs.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_copies.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_files.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_mix.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_report.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_workload.cpp"
    LINK urgengo_chains_core yaml-cpp)
  urgengo_unite(urgengo_chains_tests)
  target_compile_definitions(urgengo_chains_tests PRIVATE
    URGENGO_CHAINS_FOLDER="${CMAKE_CURRENT_LIST_DIR}")

  # The program itself, under UrgenGo on the simulated GPU.
  urgengo_add_tests(urgengo_chains_program_tests LABEL interposer
    SOURCES "${CMAKE_SOURCE_DIR}/tests/interposer/test_chains_program.cpp"
            "${CMAKE_SOURCE_DIR}/tests/interposer/test_chains_stamps.cpp"
    LINK urgengo_chains_core urgengo::benches)
  add_dependencies(urgengo_chains_program_tests
    urgengo urgengo-chains urgengo_interposer urgengo_simgpu)
  target_compile_definitions(urgengo_chains_program_tests PRIVATE
    URGENGO_PATH="$<TARGET_FILE:urgengo>"
    CHAINS_PATH="$<TARGET_FILE:urgengo-chains>"
    SIMGPU_FOLDER="$<TARGET_FILE_DIR:urgengo_simgpu>")
endif()
