// Products of Winograd's algorithm in half precision, as nothing computes them so far: 9 tiles x 2
// vectors of 8 output channels, for 8 input channels. 144 fmla, 1152 multiply-adds.
.macro tile x, first, second, channel
fmla v\first\().8h, v30.8h, v\x\().h[\channel]
fmla v\second\().8h, v31.8h, v\x\().h[\channel]
.endm
.irp x, 0, 1, 2, 3, 4, 5, 6, 7, 8
ldr q\x, [x\x, x20]
.endr
.irp channel, 0, 1, 2, 3, 4, 5, 6, 7
ldp q30, q31, [x10], #32
tile 0, 9, 10, \channel
tile 1, 11, 12, \channel
tile 2, 13, 14, \channel
tile 3, 15, 16, \channel
tile 4, 17, 18, \channel
tile 5, 19, 20, \channel
tile 6, 21, 22, \channel
tile 7, 23, 24, \channel
tile 8, 25, 26, \channel
.endr
add x20, x20, #16
cmp x20, x21
b.ne 0
