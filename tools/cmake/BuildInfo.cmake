# SPDX-License-Identifier: Apache-2.0
# urgengo_build_info(<target>): gives <target> the generated header urgengo_build_info.h with
# kVersion and kCommit. The commit is asked for at every build, so results never name a stale one.
set(_URGENGO_BUILD_INFO_SCRIPT "${CMAKE_CURRENT_LIST_DIR}/WriteBuildInfo.cmake")
add_custom_target(urgengo_build_info_header
  COMMAND "${CMAKE_COMMAND}" -D "SOURCE_DIR=${CMAKE_SOURCE_DIR}" -D "VERSION=${PROJECT_VERSION}"
          -D "OUTPUT=${CMAKE_BINARY_DIR}/generated/urgengo_build_info.h" -P "${_URGENGO_BUILD_INFO_SCRIPT}"
  BYPRODUCTS "${CMAKE_BINARY_DIR}/generated/urgengo_build_info.h"
  COMMENT "")

function(urgengo_build_info target)
  add_dependencies(${target} urgengo_build_info_header)
  target_include_directories(${target} PRIVATE "${CMAKE_BINARY_DIR}/generated")
endfunction()
