# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
if(TARGET urgengo::trace)
  urgengo_add_tests(urgengo_trace_tests LABEL unit
    SOURCES
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_cupti.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_instances.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_rules.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_kernel_times.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_pace.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_profile.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_trace_reader.cpp"
    LINK urgengo::trace urgengo::config_reader)
endif()
if(TARGET urgengo::trace)
  urgengo_add_tests(urgengo_run_trace_tests LABEL unit
    SOURCES
      "${CMAKE_SOURCE_DIR}/tests/unit/test_gate_events.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_export.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_gates.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_reader.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_recorder.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_records.cpp"
    LINK urgengo::trace urgengo::runtime urgengo::device nlohmann_json::nlohmann_json)
  target_include_directories(urgengo_run_trace_tests SYSTEM PRIVATE ${PROTOZERO_INCLUDE_DIR})
  find_package(Python3 COMPONENTS Interpreter)
  if(Python3_FOUND)
    set(_test "Perfetto's own decoder reads what is exported")
    add_test(NAME "${_test}"
      COMMAND Python3::Interpreter "${CMAKE_SOURCE_DIR}/tests/unit/test_perfetto_decoder.py"
              "$<TARGET_FILE:urgengo_run_trace_tests>" "${CMAKE_SOURCE_DIR}/build/perfetto")
    set_tests_properties("${_test}" PROPERTIES LABELS unit SKIP_RETURN_CODE 77)
  endif()
endif()
if(TARGET urgengo::cli)
  # A backend of NVTXW that writes down what it gets.
  add_library(urgengo_nvtxw_recorder MODULE "${CMAKE_SOURCE_DIR}/tests/support/nvtxw_recorder.cpp")
  target_include_directories(urgengo_nvtxw_recorder PRIVATE "${CMAKE_SOURCE_DIR}")
  target_include_directories(urgengo_nvtxw_recorder SYSTEM PRIVATE ${CUDAToolkit_INCLUDE_DIRS})
  target_link_libraries(urgengo_nvtxw_recorder PRIVATE urgengo_options nlohmann_json::nlohmann_json)
  set_target_properties(urgengo_nvtxw_recorder PROPERTIES OUTPUT_NAME nvtxw_recorder)
  urgengo_add_tests(urgengo_run_nsys_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_run_nsys.cpp"
    LINK urgengo::commands nlohmann_json::nlohmann_json)
  target_compile_definitions(urgengo_run_nsys_tests PRIVATE
    NVTXW_RECORDER_PATH="$<TARGET_FILE:urgengo_nvtxw_recorder>" SOURCE_FOLDER="${CMAKE_SOURCE_DIR}")
  add_dependencies(urgengo_run_nsys_tests urgengo_nvtxw_recorder)
endif()
if(TARGET urgengo::report)
  urgengo_add_tests(urgengo_report_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_run_report.cpp"
    LINK urgengo::report)
endif()
if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_profile_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_cmd_profile.cpp"
            "${CMAKE_SOURCE_DIR}/tests/unit/test_ctl_dump.cpp"
    LINK urgengo::commands)
endif()
