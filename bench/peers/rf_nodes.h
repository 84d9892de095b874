// What the trackers share: RF in double, the product's image grid, direct correlation and its sub-sample
// peak, medians of a field.
#pragma once

#include <cstddef>
#include <vector>

#include "bench/peers/tracker.h"
#include "service/imaging/tracking/sample_grid.h"
#include "tests/reference/ncc.h"

namespace teletact::bench {

reference::RfImage image_of(const service::RfFrame&);

// |analytic signal|: demodulated at the centre frequency, low-passed by a Hann window over one and a half
// periods each side.
reference::RfImage envelope_of(const reference::RfImage&, double periods_per_sample);

// The product's image grid and windows, in samples and lines.
struct Nodes {
  service::SampleGrid grid;
  service::ImageGrid image;
  double sample_m = 0, line_m = 0;
  Nodes(const service::RfFrame&, const service::AcquisitionGeometry&, double dx_m, double dy_m);
  int sample(int j) const { return grid.first_sample + j * grid.sample_step; }
  int line(int i) const { return grid.first_line + i * grid.line_step; }
  std::size_t at(int i, int j) const {
    return static_cast<std::size_t>(i) + static_cast<std::size_t>(grid.nx) * static_cast<std::size_t>(j);
  }
  reference::Window window(double axial_m, double lateral_m, int stride = 1) const;
};

// Displacement in samples and lines per node.
struct LagField {
  std::vector<double> axial, lateral, correlation;
  explicit LagField(std::size_t nodes) : axial(nodes), lateral(nodes), correlation(nodes, -1.0) {}
};

// Vertex of the parabola through three values; 0 when the middle is no maximum.
double parabola(double before, double peak, double after);

// Best whole lags within +-axial_reach, +-lateral_reach of the field's rounded values, then parabolas in both
// directions.
void match_nodes(const reference::RfImage& pre, const reference::RfImage& post, const Nodes&,
                 const reference::Window&, int axial_reach, int lateral_reach, LagField&);

// Every node becomes the median over (2 radius + 1)^2 nodes of its neighbourhood, in both components.
void median_filter(const Nodes&, int radius, LagField&);

// Bilinear, from the nodes of one grid to those of another.
LagField resampled(const LagField&, const Nodes& from, const Nodes& to);

Track track_of(const Nodes&, const LagField&, double min_correlation);

}  // namespace teletact::bench
