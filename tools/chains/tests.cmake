# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt: the workload program's pure parts.
if(TARGET urgengo_chains_core)
  urgengo_add_tests(urgengo_chains_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_arrivals.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_configs.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_files.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_mix.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_report.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_chains_workload.cpp"
    LINK urgengo_chains_core yaml-cpp)
  target_compile_definitions(urgengo_chains_tests PRIVATE
    URGENGO_CHAINS_FOLDER="${CMAKE_CURRENT_LIST_DIR}")
endif()
