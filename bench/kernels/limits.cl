// What a device can do at most, as the bench measures it. WIDE: floats of an item, 4 on a GPU, where a warp
// then reads whole lines, 8 on a processor.
#define JOIN_(a, b) a##b
#define JOIN(a, b) JOIN_(a, b)
#define vec JOIN(float, WIDE)

// a = b + s c. Items: vectors. Per item: 2 vector loads, 1 vector store, 2 WIDE flops.
__kernel void triad(__global const vec* restrict b, __global const vec* restrict c, __global vec* restrict a,
                    const float s, const int vectors) {
  const int n = get_global_id(0);
  if (n < vectors) a[n] = fma((vec)(s), c[n], b[n]);
}

// Items: eight chains of vectors, `steps` steps each: 16 * WIDE steps flops per item (a fused multiply-add
// counts as two), one store.
#define STEP(x) x = fma(x, (vec)(factor), (vec)(0.5f))
__kernel void multiply_add(__global vec* restrict out, const float factor, const int steps) {
  const int n = get_global_id(0);
  vec a = (float)n, b = a + 1.0f, c = a + 2.0f, d = a + 3.0f, e = a + 4.0f, f = a + 5.0f, g = a + 6.0f,
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
  out[n] = ((a + b) + (c + d)) + ((e + f) + (g + h));
}

// One item adds up one after the other.
__kernel void serial_sum(__global const float* restrict in, __global float* restrict out, const int count) {
  float sum = 0;
  for (int n = 0; n < count; ++n) sum += in[n];
  *out = sum;
}
