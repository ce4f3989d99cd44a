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
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_export.cpp"
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
