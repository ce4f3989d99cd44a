# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
urgengo_add_tests(urgengo_config_tests LABEL unit
  SOURCES
    "${CMAKE_SOURCE_DIR}/tests/unit/test_config_reader.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_config_bounds.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_profile_reader.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_resolved_config.cpp"
  LINK urgengo::config_reader)

if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_cli_tests LABEL unit
    SOURCES
      "${CMAKE_SOURCE_DIR}/tests/unit/test_cmd_run.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_doctor.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_priority_probe.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_program_check.cpp"
    LINK urgengo::commands)
  urgengo_unite(urgengo_cli_tests)
endif()
