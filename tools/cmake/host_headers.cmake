# SPDX-License-Identifier: Apache-2.0
# For cross builds (CMAKE_PROJECT_TOP_LEVEL_INCLUDES): fmt and nlohmann-json, which are headers
# that know no architecture, of the machine that builds. They lie in /usr/include beside the C
# library's, which are of the wrong architecture: so links to these two are all that is seen.
# urgengo_link_headers(<target> <folder>): the imported target <target>, headers <folder>/*.
function(urgengo_link_headers target folder)
  find_path(_headers_of_${folder} ${folder} PATHS /usr/include /usr/local/include NO_DEFAULT_PATH REQUIRED)
  set(_seen "${CMAKE_BINARY_DIR}/host_headers")
  file(MAKE_DIRECTORY "${_seen}")
  file(CREATE_LINK "${_headers_of_${folder}}/${folder}" "${_seen}/${folder}" SYMBOLIC)
  add_library(${target} INTERFACE IMPORTED GLOBAL)
  target_include_directories(${target} SYSTEM INTERFACE "${_seen}")
endfunction()

macro(urgengo_host_headers method package)
  if("${package}" STREQUAL "fmt" AND NOT TARGET fmt::fmt-header-only)
    urgengo_link_headers(fmt::fmt-header-only fmt)
    target_compile_definitions(fmt::fmt-header-only INTERFACE FMT_HEADER_ONLY=1)
    set(fmt_FOUND TRUE)
  elseif("${package}" STREQUAL "nlohmann_json" AND NOT TARGET nlohmann_json::nlohmann_json)
    urgengo_link_headers(nlohmann_json::nlohmann_json nlohmann)
    set(nlohmann_json_FOUND TRUE)
  endif()
endmacro()

cmake_language(SET_DEPENDENCY_PROVIDER urgengo_host_headers SUPPORTED_METHODS FIND_PACKAGE)
