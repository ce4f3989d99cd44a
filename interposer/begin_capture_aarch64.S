// SPDX-License-Identifier: Apache-2.0
//
// For AArch64: see begin_capture_x86_64.S.
//
// Never run: no machine of this kind was at hand.

    .text
    .macro begin_capture index
    .balign 16
.Lbegin_capture_\index:
    hint #34
    mov w17, #NUM_ENTRY_POINTS + \index
    b urgengo_lazy_entry
    .endm
    .irp index, 0, 1, 2, 3, 4, 5, 6, 7
    begin_capture \index
    .endr

    .section .data.rel.ro,"aw",%progbits
    .globl urgengo_begin_capture
    .hidden urgengo_begin_capture
    .type urgengo_begin_capture, %object
    .balign 8
urgengo_begin_capture:
    .irp index, 0, 1, 2, 3, 4, 5, 6, 7
    .quad .Lbegin_capture_\index
    .endr
    .size urgengo_begin_capture, .-urgengo_begin_capture
    .section .note.GNU-stack,"",%progbits
