// What was found, beside what is true: pairs that are near, the nearest first, each once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace teletact::client {

struct NearestMatches {
  std::vector<int> of_truth;           // index into what was found, or -1
  std::vector<std::size_t> unmatched;  // what was found and is no true one's
};

// `apart_m(truth, found)`: metres; pairs farther apart than `max_m` do not match.
template <class Apart>
NearestMatches nearest_matches(std::size_t truths, std::size_t found, double max_m, const Apart& apart_m) {
  struct Pair {
    double apart_m;
    std::size_t truth, found;
  };
  std::vector<Pair> pairs;
  for (std::size_t t = 0; t < truths; ++t)
    for (std::size_t f = 0; f < found; ++f)
      if (const double apart = apart_m(t, f); apart <= max_m) pairs.push_back({apart, t, f});
  std::ranges::sort(pairs, {}, &Pair::apart_m);
  NearestMatches out{std::vector<int>(truths, -1), {}};
  std::vector<char> used(found, 0);
  for (const Pair& pair : pairs)
    if (out.of_truth[pair.truth] < 0 && !used[pair.found])
      out.of_truth[pair.truth] = static_cast<int>(pair.found), used[pair.found] = 1;
  for (std::size_t f = 0; f < found; ++f)
    if (!used[f]) out.unmatched.push_back(f);
  return out;
}

}  // namespace teletact::client
