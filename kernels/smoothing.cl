// How far a refinement step smooths (T2.3): medians over all nodes, from them the weights of the edges. One
// work-group; on a processor it is one item, WIDTH numbers at a time.
#ifndef WIDTH  // one node on a GPU
#define WIDTH 2
#endif
#include "sums.clh"

// Numbers of `model` after weights, spreads and sensitivities, lateral and axial each, as in refinement.cpp.
#define MEDIAN 8  // of the information
#define LENGTH 10

#define BITS JOIN(int, WIDTH)
#define AS_BITS JOIN(as_int, WIDTH)

typedef struct {
  float dx_m, dy_m, line_pitch_m, sample_pitch_m;  // of the nodes, of the image
  float least_strain, change_m;  // what strain is taken to change by: change_m times its median magnitude
  float shortest_m, longest_lateral_m, longest_axial_m;
} Smoothing;

// How many of the even and the odd numbers that are not negative lie below `limits`, given as their bits,
// which are in the same order; of up to 2^24.
float2 below(global const float* restrict values, const int count, const int2 limits, local accum* shared) {
  int pair[WIDTH];
  for (int lane = 0; lane < WIDTH; ++lane) pair[lane] = lane % 2 ? limits.y : limits.x;
  const BITS limit = JOIN(vload, WIDTH)(0, pair);
  BITS found = (BITS)(0);
  for (int v = get_local_id(0); v < count; v += GROUP)
    found -= AS_BITS(JOIN(vload, WIDTH)(v, values)) < limit;  // a true comparison is -1
  int lanes[WIDTH];
  JOIN(vstore, WIDTH)(found, 0, lanes);
  int2 sum = (int2)(0);
  for (int lane = 0; lane < WIDTH; lane += 2) sum += (int2)(lanes[lane], lanes[lane + 1]);
  return (float2)((float)sum_of_group(sum.x, shared), (float)sum_of_group(sum.y, shared));
}

// Of the even and the odd numbers the one that so many are below: bit by bit the largest with no more.
float2 of_rank(global const float* restrict values, const int count, const float2 rank, local accum* shared) {
  int2 found = (int2)(0);
  for (int bit = 1 << 30; bit > 0; bit >>= 1) {
    const float2 less = below(values, count, found | bit, shared);
    found |= (less <= rank) & bit;
  }
  return as_float2(found);
}

// Both arrays end with zeros in whole vectors: `information`, lateral and axial, of those nodes that hear
// anything, and `strain`, the magnitude; the upper of two middle ones each, 0 of none.
kernel OF_GROUP void weigh_edges(global const float* restrict information,
                                 global const float* restrict strain, global float* restrict model,
                                 const Smoothing s, const int nodes, const int informations,
                                 const int strains) {
  local accum shared[GROUP];
  const float2 total = (float2)((float)(informations * WIDTH / 2)),
               silent = below(information, informations, (int2)(1), shared),
               middle = silent + floor(0.5f * (total - silent));
  const float2 heard = of_rank(information, informations, middle, shared);
  // Even and odd nodes are one.
  int found = 0;
  const float rank = (float)(strains * WIDTH - nodes + nodes / 2);
  for (int bit = 1 << 30; bit > 0; bit >>= 1) {
    const float2 less = below(strain, strains, (int2)(found | bit), shared);
    if (less.x + less.y <= rank) found |= bit;
  }
  if (get_local_id(0) != 0) return;
  const float change_m = s.change_m * fmax(s.least_strain, as_float(found) * s.sample_pitch_m / s.dy_m);
  const float2 median = (float2)(silent.x < total.x ? heard.x : 0.0f, silent.y < total.y ? heard.y : 0.0f),
               held = fmax(median, 1e-12f),
               free_m = sqrt(s.dx_m * s.dy_m / held) * (float2)(s.line_pitch_m, s.sample_pitch_m) / change_m,
               length_m =
                   clamp(free_m, (float2)(s.shortest_m), (float2)(s.longest_lateral_m, s.longest_axial_m));
  vstore2(held * length_m * length_m / (s.dx_m * s.dx_m), 0, model);
  vstore2(held * length_m * length_m / (s.dy_m * s.dy_m), 1, model);
  vstore2(median, 0, model + MEDIAN);
  vstore2(length_m, 0, model + LENGTH);
}
