// One step of the regularised refinement (T2.3) in double precision, its system solved directly: what
// refinement.cl and the solver are held against. Pairs of numbers are lateral, axial.
#pragma once

#include <array>
#include <vector>

#include "tests/reference/ncc.h"

namespace teletact::reference {

// Node (i, j) at line first_line + i line_step, sample first_sample + j sample_step; index i + nx j.
struct NodeGrid {
  int nx = 1, ny = 1, first_line = 0, line_step = 1, first_sample = 0, sample_step = 1;
  std::size_t at(int i, int j) const {
    return static_cast<std::size_t>(i) + static_cast<std::size_t>(nx) * static_cast<std::size_t>(j);
  }
};

using Pair = std::array<double, 2>;

struct RegularisedModel {
  Pair weight_along{}, weight_down{};  // of the edges between neighbours along i and along j
  Pair spread{1, 1}, sensitivity{1, 1};
  int gradient_radius = 3, noise_radius = 2;
  double cauchy_squared = 9;  // in the robust weights 1 / (1 + d^2 / (this noise))
};

struct RegularisedStep {
  std::vector<Pair> correction, information;
  std::vector<double> correlation;
  std::vector<double> noise;  // mean squared difference per pixel, without the pulse's part
};

// From the images mean and difference = pre - warped post, in which zero means that nothing is known, and the
// field (lines, samples) that warped them:
//   minimise over v  sum_n v.h_n v - 2 v.b_n  +  sum over edges of weight (D(u + v) - <D u>)^2
// h_n, b_n: hat-weighted sums of g g^T and g d over the pixels around node n, scaled by the noise around it;
// <D u>: mean of the two ends' gradients, each the plain average over the nodes within gradient_radius.
RegularisedStep regularised_step(const RfImage& mean, const RfImage& difference, const NodeGrid&,
                                 const std::vector<Pair>& field, const RegularisedModel&);

// Part of the squared difference around node (i, j) that is left when the least-squares combination of the
// mean m and its derivatives m_yy, m_xy, m_xx is taken off it, at least .05 (pulse.cl says why); noise: of
// each node, for the robust weights.
double unexplained_part(const RfImage& mean, const RfImage& difference, const NodeGrid&, int i, int j,
                        const std::vector<double>& noise, const RegularisedModel&);

// What the edges' pull says of the smoothing's bias: pull over information, both summed over the nodes within
// `radius`; 0 where nothing is known.
std::vector<Pair> edge_bias(const NodeGrid&, const std::vector<Pair>& information,
                            const std::vector<Pair>& pull, int radius);

// Gradient (per node step) of both components along i and along j around node (i, j).
std::array<Pair, 2> mean_gradient(const NodeGrid&, const std::vector<Pair>& field, int i, int j, int radius);

}  // namespace teletact::reference
