// What a device can do at most, as the bench measures it: memory bandwidth by a triad, arithmetic by
// independent chains of fused multiply-adds.

// a = b + s c. Items: vectors of 8. Per item: 2 vector loads, 1 vector store, 16 flops.
__kernel void triad(__global const float* restrict b, __global const float* restrict c,
                    __global float* restrict a, const float s, const int vectors) {
  const int n = get_global_id(0);
  if (n < vectors) vstore8(fma((float8)(s), vload8(n, c), vload8(n, b)), n, a);
}

// Items: eight chains of float8, `steps` steps each: 16 * 8 steps flops per item (a fused multiply-add counts
// as two), one store.
#define STEP(x) x = fma(x, (float8)(factor), (float8)(0.5f))
__kernel void multiply_add(__global float* restrict out, const float factor, const int steps) {
  const int n = get_global_id(0);
  float8 a = (float)n, b = a + 1.0f, c = a + 2.0f, d = a + 3.0f, e = a + 4.0f, f = a + 5.0f, g = a + 6.0f,
         h = a + 7.0f;
  for (int k = 0; k < steps; ++k) {
    STEP(a);
    STEP(b);
    STEP(c);
    STEP(d);
    STEP(e);
    STEP(f);
    STEP(g);
    STEP(h);
  }
  const float8 sum = ((a + b) + (c + d)) + ((e + f) + (g + h));
  out[n] = sum.s0 + sum.s1 + sum.s2 + sum.s3 + sum.s4 + sum.s5 + sum.s6 + sum.s7;
}
