# SPDX-License-Identifier: Apache-2.0
# Compile options that every target of the project shares, and one function to declare a library.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_C_STANDARD 99)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set(CMAKE_RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/bin")

# GCC 12 finds faults in its own std::string once it has inlined enough of it (GCC bugs 105329 and
# 105651); more often with precompiled headers, whose lines no longer count as a system header's.
set(_urgengo_false_warnings -Wno-restrict)
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
  list(APPEND _urgengo_false_warnings
    -Wno-array-bounds -Wno-stringop-overflow -Wno-stringop-overread -Wno-maybe-uninitialized)
endif()

add_library(urgengo_options INTERFACE)
target_compile_options(urgengo_options INTERFACE
  # Host and GPU decide to the bit (host/base/host_device.h): nothing is fused.
  $<$<AND:$<COMPILE_LANGUAGE:CXX>,$<STREQUAL:${CMAKE_SYSTEM_PROCESSOR},aarch64>>:-ffp-contract=off>
  $<$<COMPILE_LANGUAGE:CXX,C>:-Wall -Wextra -Wshadow -Wno-unused-parameter>
  $<$<COMPILE_LANGUAGE:CXX>:-Wnon-virtual-dtor -Woverloaded-virtual ${_urgengo_false_warnings}>
  $<$<AND:$<BOOL:${URGENGO_WERROR}>,$<COMPILE_LANGUAGE:CXX,C>>:-Werror>)

if(URGENGO_SANITIZE)
  string(REPLACE "," ";" _urgengo_sanitizers "${URGENGO_SANITIZE}")
  foreach(_name IN LISTS _urgengo_sanitizers)
    if(NOT _name MATCHES "^(address|thread|undefined)$")
      message(FATAL_ERROR "URGENGO_SANITIZE: found '${_name}', accepted: address, thread, undefined")
    endif()
  endforeach()
  target_compile_options(urgengo_options INTERFACE
    $<$<COMPILE_LANGUAGE:CXX,C>:-fsanitize=${URGENGO_SANITIZE} -fno-omit-frame-pointer>)
  target_link_options(urgengo_options INTERFACE -fsanitize=${URGENGO_SANITIZE})
endif()

# urgengo_add_library(<folder> SOURCES <file>... [LINK <target>...])
# Declares the static library urgengo_<folder> with the alias urgengo::<folder>.
function(urgengo_add_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;LINK" ${ARGN})
  add_library(urgengo_${name} STATIC ${ARG_SOURCES})
  add_library(urgengo::${name} ALIAS urgengo_${name})
  target_include_directories(urgengo_${name} PUBLIC "${CMAKE_SOURCE_DIR}")
  target_link_libraries(urgengo_${name} PUBLIC urgengo::include ${ARG_LINK} PRIVATE urgengo_options)
  set_target_properties(urgengo_${name} PROPERTIES
    CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
endfunction()

# urgengo_unite(<target>...): compiles so many files of each at a time that what they include is read
# once for all of them. For tools and tests alone: what programs load is compiled file by file.
option(URGENGO_UNITE "Compile several files of tools and tests at a time" ON)
function(urgengo_unite)
  if(URGENGO_UNITE)
    set_target_properties(${ARGN} PROPERTIES
      UNITY_BUILD ON UNITY_BUILD_BATCH_SIZE 8 UNITY_BUILD_UNIQUE_ID URGENGO_UNITY_ID)
  endif()
endfunction()

# urgengo_unite_groups(<target> "<file> <file>..."...): the same for the files of each group alone. No
# two of a group have something of the same name; what is in no group is compiled by itself.
function(urgengo_unite_groups target)
  if(NOT URGENGO_UNITE)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
  foreach(_group IN LISTS ARGN)
    string(REPLACE " " ";" _files "${_group}")
    list(GET _files 0 _first)
    cmake_path(GET _first STEM _name)
    set_source_files_properties(${_files} PROPERTIES UNITY_GROUP "${_name}")
  endforeach()
endfunction()
