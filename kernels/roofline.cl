// What a device can do at most, as the bench measures it: memory bandwidth by a triad, arithmetic by independent
// chains of fused multiply-adds.

// a = b + s c. Items: vectors of 8. Per item: 2 vector loads, 1 vector store, 16 flops.
__kernel void triad(__global const float* restrict b, __global const float* restrict c, __global float* restrict a,
                    const float s, const int vectors) {
  const int n = get_global_id(0);
  if (n < vectors) vstore8(fma((float8)(s), vload8(n, c), vload8(n, b)), n, a);
}

// Items: CHAINS chains of float8, `steps` steps each: 16 CHAINS steps flops per item, one store.
#define CHAINS 8
__kernel void multiply_add(__global float* restrict out, const float factor, const int steps) {
  const int n = get_global_id(0);
  float8 x[CHAINS];
  for (int c = 0; c < CHAINS; ++c) x[c] = (float8)((float)(n + c));
  for (int k = 0; k < steps; ++k)
    for (int c = 0; c < CHAINS; ++c) x[c] = fma(x[c], (float8)(factor), (float8)(0.5f));
  float8 sum = 0.0f;
  for (int c = 0; c < CHAINS; ++c) sum += x[c];
  out[n] = sum.s0 + sum.s1 + sum.s2 + sum.s3 + sum.s4 + sum.s5 + sum.s6 + sum.s7;
}
