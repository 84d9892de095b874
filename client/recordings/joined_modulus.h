// What several pairs of one place say of its modulus together (T3.7).
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace teletact::client {

// Nodes (i, j) at i + nx * j.
struct MapNodes {
  std::size_t nx = 0, ny = 0;
  double dx_m = 0, dy_m = 0;
};

// Of one pair.
struct PairModulus {
  std::vector<float> log_modulus;    // ln(E / Pa), or relative; NaN where nothing is said
  std::vector<float> log_deviation;  // standard deviation of it
  double quality = 0;                // 0 to 1
  double shared_deviation = 0;       // the part of it that all places and pairs have alike, as it states
};

struct PairUse {
  std::string left_out;  // why; empty: used
  double share = 0;      // of the weights, median over the nodes
  double level = 1;      // its modulus over that of all, median: of a relative one what it was divided by
};

struct JoinedModulus {
  std::vector<float> log_modulus, log_deviation;  // as PairModulus
  std::vector<PairUse> pairs;
  std::size_t used = 0;
  // Medians over the nodes that two pairs or more tell, standard deviations of ln E; 0 of a single pair.
  double of_one = 0;    // that a pair states
  double scatter = 0;   // by which pairs differ: this falls with their number
  double shared = 0;    // which does not
  double part = 0;      // of the stated variance that differs from pair to pair
  bool differ = false;  // pairs by more than they state, and none can be told to be wrong
};

// Leaves out pairs of low quality beside the best and pairs that differ from the others, and weights the
// rest by 1 / deviation^2. A relative modulus is matched by its median over the nodes that are told in
// common. Throws std::invalid_argument where maps do not fill the nodes or there is none.
JoinedModulus join_moduli(const MapNodes& nodes, const std::vector<PairModulus>& pairs, bool absolute);

}  // namespace teletact::client
