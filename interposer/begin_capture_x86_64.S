// SPDX-License-Identifier: Apache-2.0
//
// What programs get for functions that begin a capture and that we do not know: see
// unknown_captures.h. As the stubs of entry points whose driver is not loaded yet do, each pushes
// its index and goes through urgengo_lazy_entry; NUM_ENTRY_POINTS is the first one's.

    .text
    .macro begin_capture index
    .balign 16
.Lbegin_capture_\index:
    endbr64
    pushq $NUM_ENTRY_POINTS + \index
    jmp urgengo_lazy_entry
    .endm
    .irp index, 0, 1, 2, 3, 4, 5, 6, 7
    begin_capture \index
    .endr

    .section .data.rel.ro,"aw",%progbits
    .globl urgengo_begin_capture
    .hidden urgengo_begin_capture
    .type urgengo_begin_capture, @object
    .balign 8
urgengo_begin_capture:
    .irp index, 0, 1, 2, 3, 4, 5, 6, 7
    .quad .Lbegin_capture_\index
    .endr
    .size urgengo_begin_capture, .-urgengo_begin_capture
    .section .note.GNU-stack,"",%progbits
