# SPDX-License-Identifier: Apache-2.0
# Included by tests/unit/CMakeLists.txt.
urgengo_add_tests(urgengo_config_tests LABEL unit
  SOURCES
    "${CMAKE_SOURCE_DIR}/tests/unit/test_config_reader.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_config_bounds.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_config_difference.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_profile_reader.cpp"
    "${CMAKE_SOURCE_DIR}/tests/unit/test_resolved_config.cpp"
  LINK urgengo::config_reader)

if(TARGET urgengo::cli)
  urgengo_add_tests(urgengo_cli_tests LABEL unit
    SOURCES
      "${CMAKE_SOURCE_DIR}/tests/unit/test_cmd_run.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_doctor.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_run_findings.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_find_pages.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_page_reader.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_paired_blocks.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_priority_probe.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_program_check.cpp"
      "${CMAKE_SOURCE_DIR}/tests/unit/test_top_view.cpp"
    LINK urgengo::commands)
  urgengo_unite(urgengo_cli_tests)
  urgengo_add_tests(urgengo_export_tests LABEL unit
    SOURCES "${CMAKE_SOURCE_DIR}/tests/unit/test_export.cpp"
    LINK urgengo::export urgengo::commands)
  target_compile_definitions(urgengo_export_tests PRIVATE URGENGO_SOURCE="${CMAKE_SOURCE_DIR}")
endif()
