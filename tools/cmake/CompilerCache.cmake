# SPDX-License-Identifier: Apache-2.0
# Compiles through ccache where it is installed: a clean clone, CI's among them, then compiles only
# what no other clone on this machine has compiled. (.ci/run on two cores: 12 minutes, and 23 where
# nothing is kept.)
#
# What a build needs of ccache is said here, so that `ninja` alone is enough: that paths are relative
# to the source folder, and that GCC's precompiled headers are kept, too.
option(URGENGO_CCACHE "Compile through ccache where it is installed" ON)
find_program(URGENGO_CCACHE_PROGRAM ccache)
mark_as_advanced(URGENGO_CCACHE_PROGRAM)

set(_urgengo_keeps_precompiled OFF)
if(NOT CMAKE_CXX_COMPILER_LAUNCHER AND URGENGO_CCACHE AND URGENGO_CCACHE_PROGRAM)
  set(_urgengo_launcher "${CMAKE_COMMAND}" -E env "CCACHE_BASEDIR=${CMAKE_SOURCE_DIR}"
    CCACHE_NOHASHDIR=1 CCACHE_SLOPPINESS=pch_defines,time_macros "${URGENGO_CCACHE_PROGRAM}")
  set(CMAKE_CXX_COMPILER_LAUNCHER "${_urgengo_launcher}")
  set(CMAKE_C_COMPILER_LAUNCHER "${_urgengo_launcher}")
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-fpch-preprocess>)
    set(_urgengo_keeps_precompiled ON)
  endif()
endif()
# Every file includes what it uses, so any target builds without precompiled headers. With another
# compiler, or as others have set it up, ccache does not keep files compiled with one.
if(CMAKE_CXX_COMPILER_LAUNCHER MATCHES "ccache" AND NOT _urgengo_keeps_precompiled)
  set(CMAKE_DISABLE_PRECOMPILE_HEADERS ON)
endif()
