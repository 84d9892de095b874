#include "bench/peers/rf_nodes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "bench/basics/median.h"

namespace teletact::bench {

using reference::RfImage;
using reference::Window;

RfImage image_of(const service::RfFrame& frame) {
  return {static_cast<int>(frame.sample_count),
          static_cast<int>(frame.line_count),
          {frame.samples.begin(), frame.samples.end()}};
}

RfImage envelope_of(const RfImage& rf, double periods_per_sample) {
  const int half = std::max(1, static_cast<int>(std::lround(1.5 / periods_per_sample)));
  std::vector<double> taps;
  for (int k = -half; k <= half; ++k) taps.push_back(.5 + .5 * std::cos(std::numbers::pi * k / (half + 1)));
  RfImage out{rf.samples, rf.lines, std::vector<double>(rf.values.size())};
  std::vector<double> in_phase(static_cast<std::size_t>(rf.samples)), quadrature(in_phase.size());
  for (int l = 0; l < rf.lines; ++l) {
    for (int k = 0; k < rf.samples; ++k) {
      const double angle = 2 * std::numbers::pi * periods_per_sample * k;
      in_phase[static_cast<std::size_t>(k)] = rf.at(k, l) * std::cos(angle);
      quadrature[static_cast<std::size_t>(k)] = rf.at(k, l) * std::sin(angle);
    }
    for (int k = 0; k < rf.samples; ++k) {
      double i = 0, q = 0;
      for (int t = std::max(-half, -k); t <= std::min(half, rf.samples - 1 - k); ++t) {
        i += taps[static_cast<std::size_t>(t + half)] * in_phase[static_cast<std::size_t>(k + t)];
        q += taps[static_cast<std::size_t>(t + half)] * quadrature[static_cast<std::size_t>(k + t)];
      }
      out.values[static_cast<std::size_t>(k + rf.samples * l)] = std::hypot(i, q);
    }
  }
  return out;
}

Nodes::Nodes(const service::RfFrame& frame, const service::AcquisitionGeometry& g, double dx_m, double dy_m)
    : grid(service::centred_grid(frame, std::max(1, static_cast<int>(std::lround(dx_m / g.line_pitch_m))),
                                 std::max(1, static_cast<int>(std::lround(dy_m / g.sample_pitch_m()))))),
      image(service::image_grid(grid, g)),
      sample_m(g.sample_pitch_m()),
      line_m(g.line_pitch_m) {}

Window Nodes::window(double axial_m, double lateral_m, int stride) const {
  return {std::max(1, static_cast<int>(std::lround(axial_m / 2 / sample_m))),
          std::max(1, static_cast<int>(std::lround(lateral_m / 2 / line_m))), stride};
}

double parabola(double before, double peak, double after) {
  const double curvature = before - 2 * peak + after;
  return curvature < 0 ? std::clamp((before - after) / (2 * curvature), -0.5, 0.5) : 0;
}

void match_nodes(const RfImage& pre, const RfImage& post, const Nodes& nodes, const Window& window,
                 int axial_reach, int lateral_reach, LagField& field) {
  for (int j = 0; j < nodes.grid.ny; ++j)
    for (int i = 0; i < nodes.grid.nx; ++i) {
      const std::size_t n = nodes.at(i, j);
      const auto ncc = [&](int axial, int lateral) {
        return reference::normalised_cross_correlation(pre, post, nodes.sample(j), nodes.line(i), window,
                                                       axial, lateral);
      };
      const int a0 = static_cast<int>(std::lround(field.axial[n])),
                l0 = static_cast<int>(std::lround(field.lateral[n]));
      int axial = a0, lateral = l0;
      double best = -2;
      for (int l = l0 - lateral_reach; l <= l0 + lateral_reach; ++l)
        for (int a = a0 - axial_reach; a <= a0 + axial_reach; ++a)
          if (const double c = ncc(a, l); c > best) best = c, axial = a, lateral = l;
      field.axial[n] = axial + parabola(ncc(axial - 1, lateral), best, ncc(axial + 1, lateral));
      field.lateral[n] = lateral + parabola(ncc(axial, lateral - 1), best, ncc(axial, lateral + 1));
      field.correlation[n] = best;
    }
}

void median_filter(const Nodes& nodes, int radius, LagField& field) {
  for (std::vector<double>* component : {&field.axial, &field.lateral}) {
    const std::vector<double> before = *component;
    for (int j = 0; j < nodes.grid.ny; ++j)
      for (int i = 0; i < nodes.grid.nx; ++i) {
        std::vector<double> around;
        for (int r = std::max(0, j - radius); r <= std::min(nodes.grid.ny - 1, j + radius); ++r)
          for (int c = std::max(0, i - radius); c <= std::min(nodes.grid.nx - 1, i + radius); ++c)
            around.push_back(before[nodes.at(c, r)]);
        (*component)[nodes.at(i, j)] = median_of(std::move(around));
      }
  }
}

LagField resampled(const LagField& field, const Nodes& from, const Nodes& to) {
  LagField out(static_cast<std::size_t>(to.grid.nodes()));
  for (int j = 0; j < to.grid.ny; ++j)
    for (int i = 0; i < to.grid.nx; ++i) {
      const double x =
          std::clamp(static_cast<double>(to.line(i) - from.grid.first_line) / from.grid.line_step, 0.0,
                     from.grid.nx - 1.0);
      const double y =
          std::clamp(static_cast<double>(to.sample(j) - from.grid.first_sample) / from.grid.sample_step, 0.0,
                     from.grid.ny - 1.0);
      const int c = std::min(static_cast<int>(x), std::max(0, from.grid.nx - 2)),
                r = std::min(static_cast<int>(y), std::max(0, from.grid.ny - 2));
      const int c1 = std::min(c + 1, from.grid.nx - 1), r1 = std::min(r + 1, from.grid.ny - 1);
      const auto mix = [&](const std::vector<double>& f) {
        const double s = x - c, t = y - r;
        return (1 - t) * ((1 - s) * f[from.at(c, r)] + s * f[from.at(c1, r)]) +
               t * ((1 - s) * f[from.at(c, r1)] + s * f[from.at(c1, r1)]);
      };
      out.axial[to.at(i, j)] = mix(field.axial);
      out.lateral[to.at(i, j)] = mix(field.lateral);
    }
  return out;
}

Track track_of(const Nodes& nodes, const LagField& field, double min_correlation) {
  Track t;
  t.grid = nodes.image;
  t.correlation = field.correlation;
  for (std::size_t n = 0; n < field.axial.size(); ++n) {
    t.axial_m.push_back(field.axial[n] * nodes.sample_m);
    t.lateral_m.push_back(field.lateral[n] * nodes.line_m);
    t.valid.push_back(field.correlation[n] >= min_correlation ? 1 : 0);
  }
  return t;
}

}  // namespace teletact::bench
