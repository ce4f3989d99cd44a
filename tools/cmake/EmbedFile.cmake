# SPDX-License-Identifier: Apache-2.0
# urgengo_embed_file(<target> <symbol> <file>)
# Embeds a file in <target> as `extern "C" const unsigned char <symbol>[]` (or char), ended by
# <symbol>_end.
function(urgengo_embed_file target symbol file)
  get_filename_component(_file "${file}" ABSOLUTE)
  get_filename_component(_name "${file}" NAME)
  string(MAKE_C_IDENTIFIER "${_name}" _name)
  set(_asm "${CMAKE_CURRENT_BINARY_DIR}/${_name}.S")
  file(CONFIGURE OUTPUT "${_asm}" @ONLY CONTENT [[
.section .rodata
.balign 16
.globl @symbol@
.hidden @symbol@
@symbol@:
.incbin "@_file@"
.globl @symbol@_end
.hidden @symbol@_end
@symbol@_end:
.section .note.GNU-stack,"",%progbits
]])
  set_source_files_properties("${_asm}" PROPERTIES OBJECT_DEPENDS "${_file}")
  target_sources(${target} PRIVATE "${_asm}")
endfunction()
