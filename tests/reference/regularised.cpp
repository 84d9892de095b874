#include "tests/reference/regularised.h"

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace teletact::reference {
namespace {

// Sums over a node's pixels.
struct NodeData {
  double xx = 0, xy = 0, yy = 0, xd = 0, yd = 0, mm = 0, md = 0, dd = 0, pixels = 0;
  void operator+=(const NodeData& o) { mm += o.mm, md += o.md, dd += o.dd, pixels += o.pixels; }
};

double axial_gradient(const RfImage& m, int k, int l) {
  const auto d = [&](int n) { return m.at(k + n, l) - m.at(k - n, l); };
  return (45 * d(1) - 9 * d(2) + d(3)) / 60;
}

double lateral_gradient(const RfImage& m, int k, int l) {
  if (l < 2 || l > m.lines - 3) return 0;
  const auto d = [&](int n) { return m.at(k, l + n) - m.at(k, l - n); };
  return (8 * d(1) - d(2)) / 12;
}

NodeData data_of(const RfImage& mean, const RfImage& difference, const NodeGrid& g, int i, int j,
                 double outlier_scale) {
  NodeData sum;
  const int line = g.first_line + i * g.line_step, sample = g.first_sample + j * g.sample_step;
  for (int l = std::max(0, line - g.line_step); l <= std::min(mean.lines - 1, line + g.line_step); ++l)
    for (int k = sample - g.sample_step; k <= sample + g.sample_step; ++k) {
      const double m = mean.at(k, l), d = difference.at(k, l);
      const double hat =
          (1 - std::abs(l - line) / double(g.line_step)) * (1 - std::abs(k - sample) / double(g.sample_step));
      const double w = hat / (1 + (outlier_scale > 0 ? d * d / outlier_scale : 0));
      const double gx = lateral_gradient(mean, k, l), gy = axial_gradient(mean, k, l);
      sum.xx += w * gx * gx, sum.xy += w * gx * gy, sum.yy += w * gy * gy;
      sum.xd += w * gx * d, sum.yd += w * gy * d;
      sum.mm += w * m * m, sum.md += w * m * d, sum.dd += w * d * d;
      if (m != 0) sum.pixels += w;
    }
  return sum;
}

using Even = Eigen::Vector4d;  // the mean and its even derivatives up to the second

Even even_derivatives(const RfImage& m, int k, int l) {
  const auto pair = [&](int n) { return m.at(k + n, l) + m.at(k - n, l); };
  const double yy = (270 * pair(1) - 27 * pair(2) + 2 * pair(3) - 490 * m.at(k, l)) / 180;
  const double xy = (m.at(k + 1, l + 1) - m.at(k - 1, l + 1) - m.at(k + 1, l - 1) + m.at(k - 1, l - 1)) / 4;
  return {m.at(k, l), yy, xy, m.at(k, l - 1) + m.at(k, l + 1) - 2 * m.at(k, l)};
}

struct Pulse {
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
  Even with = Even::Zero();  // the difference
  double dd = 0;
};

// Over a node's own lines and, in whole eights, samples.
void add_cell(Pulse& sum, const RfImage& mean, const RfImage& difference, const NodeGrid& g, int i, int j,
              double outlier_scale) {
  const int half = 4 * ((g.sample_step + 7) / 8);
  const int line = g.first_line + i * g.line_step - g.line_step / 2,
            sample = g.first_sample + j * g.sample_step;
  for (int l = std::max(line, 1); l < std::min(line + g.line_step, mean.lines - 1); ++l)
    for (int k = sample - half; k < sample + half; ++k) {
      const double d = difference.at(k, l), w = 1 / (1 + (outlier_scale > 0 ? d * d / outlier_scale : 0));
      const Even r = even_derivatives(mean, k, l);
      sum.normal += w * r * r.transpose();
      sum.with += w * d * r;
      sum.dd += w * d * d;
    }
}

NodeData around(const std::vector<NodeData>& data, const NodeGrid& g, int i, int j, int radius) {
  NodeData sum;
  for (int n = std::max(0, j - radius); n <= std::min(g.ny - 1, j + radius); ++n)
    for (int m = std::max(0, i - radius); m <= std::min(g.nx - 1, i + radius); ++m) sum += data[g.at(m, n)];
  return sum;
}

struct System {
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd rhs;
};

// weight (v_b - v_a + gap)^2
void add_edge(System& s, std::size_t a, std::size_t b, std::size_t c, double weight, double gap) {
  const int ia = static_cast<int>(2 * a + c), ib = static_cast<int>(2 * b + c);
  s.entries.insert(s.entries.end(),
                   {{ia, ia, weight}, {ib, ib, weight}, {ia, ib, -weight}, {ib, ia, -weight}});
  s.rhs[ia] += weight * gap;
  s.rhs[ib] -= weight * gap;
}

void add_edges(System& s, const NodeGrid& g, const std::vector<Pair>& field, const RegularisedModel& model) {
  for (int j = 0; j < g.ny; ++j)
    for (int i = 0; i < g.nx; ++i)
      for (std::size_t down = 0; down < 2; ++down) {
        const int to_i = i + (down ? 0 : 1), to_j = j + (down ? 1 : 0);
        if (to_i >= g.nx || to_j >= g.ny) continue;
        const auto here = mean_gradient(g, field, i, j, model.gradient_radius),
                   there = mean_gradient(g, field, to_i, to_j, model.gradient_radius);
        const std::size_t a = g.at(i, j), b = g.at(to_i, to_j);
        for (std::size_t c = 0; c < 2; ++c)
          add_edge(s, a, b, c, (down ? model.weight_down : model.weight_along)[c],
                   field[b][c] - field[a][c] - 0.5 * (here[down][c] + there[down][c]));
      }
}

}  // namespace

double unexplained_part(const RfImage& mean, const RfImage& difference, const NodeGrid& g, int i, int j,
                        const std::vector<double>& noise, const RegularisedModel& model) {
  constexpr double kMin = 0.05;
  Pulse sum;
  for (int n = std::max(0, j - model.noise_radius); n <= std::min(g.ny - 1, j + model.noise_radius); ++n)
    for (int m = std::max(0, i - model.noise_radius); m <= std::min(g.nx - 1, i + model.noise_radius); ++m)
      add_cell(sum, mean, difference, g, m, n, model.cauchy_squared * noise[g.at(m, n)]);
  if (!(sum.dd > 0)) return 1;
  const double explained = sum.with.dot(sum.normal.ldlt().solve(sum.with));
  return std::max(kMin, 1 - explained / sum.dd);
}

std::vector<Pair> edge_bias(const NodeGrid& g, const std::vector<Pair>& information,
                            const std::vector<Pair>& pull, int radius) {
  std::vector<Pair> bias(pull.size(), Pair{});
  for (int j = 0; j < g.ny; ++j)
    for (int i = 0; i < g.nx; ++i)
      for (std::size_t c = 0; c < 2; ++c) {
        double h = 0, force = 0;
        for (int n = std::max(0, j - radius); n <= std::min(g.ny - 1, j + radius); ++n)
          for (int m = std::max(0, i - radius); m <= std::min(g.nx - 1, i + radius); ++m)
            h += information[g.at(m, n)][c], force += pull[g.at(m, n)][c];
        if (h > 0) bias[g.at(i, j)][c] = force / h;
      }
  return bias;
}

std::array<Pair, 2> mean_gradient(const NodeGrid& g, const std::vector<Pair>& field, int i, int j,
                                  int radius) {
  std::array<Pair, 2> sum{}, count{};
  const int left = std::max(0, i - radius), right = std::min(g.nx - 1, i + radius);
  const int upper = std::max(0, j - radius), lower = std::min(g.ny - 1, j + radius);
  for (int n = upper; n <= lower; ++n)
    for (int m = left; m <= right; ++m)
      for (std::size_t c = 0; c < 2; ++c) {
        if (m < right) sum[0][c] += field[g.at(m + 1, n)][c] - field[g.at(m, n)][c], ++count[0][c];
        if (n < lower) sum[1][c] += field[g.at(m, n + 1)][c] - field[g.at(m, n)][c], ++count[1][c];
      }
  for (std::size_t d = 0; d < 2; ++d)
    for (std::size_t c = 0; c < 2; ++c) sum[d][c] /= std::max(1.0, count[d][c]);
  return sum;
}

RegularisedStep regularised_step(const RfImage& mean, const RfImage& difference, const NodeGrid& g,
                                 const std::vector<Pair>& field, const RegularisedModel& model) {
  const std::size_t nodes = field.size();
  std::vector<NodeData> data(nodes);
  std::vector<double> noise(nodes, 0.0);
  RegularisedStep out{std::vector<Pair>(nodes), std::vector<Pair>(nodes), std::vector<double>(nodes), {}};
  for (int pass = 0; pass < 2; ++pass) {
    for (int j = 0; j < g.ny; ++j)
      for (int i = 0; i < g.nx; ++i)
        data[g.at(i, j)] = data_of(mean, difference, g, i, j, model.cauchy_squared * noise[g.at(i, j)]);
    for (int j = 0; j < g.ny; ++j)
      for (int i = 0; i < g.nx; ++i) {
        const NodeData local = around(data, g, i, j, model.noise_radius);
        const double pre = local.mm + local.dd / 4 + local.md, post = local.mm + local.dd / 4 - local.md;
        noise[g.at(i, j)] = local.dd / local.pixels;
        out.correlation[g.at(i, j)] = (local.mm - local.dd / 4) / std::sqrt(pre * post);
      }
  }
  out.noise = noise;
  for (int j = 0; j < g.ny; ++j)
    for (int i = 0; i < g.nx; ++i)
      out.noise[g.at(i, j)] *= unexplained_part(mean, difference, g, i, j, noise, model);
  const auto size = static_cast<Eigen::Index>(2 * nodes);
  System system{{}, Eigen::VectorXd::Zero(size)};
  for (std::size_t n = 0; n < nodes; ++n) {
    const NodeData& d = data[n];
    const auto gain = [&](std::size_t c) { return model.sensitivity[c] / (model.spread[c] * out.noise[n]); };
    const auto scale = [&](std::size_t c) { return gain(c) * model.sensitivity[c]; };
    out.information[n] = {scale(0) * d.xx, scale(1) * d.yy};
    const double cross = std::sqrt(scale(0) * scale(1)) * d.xy;
    const int x = static_cast<int>(2 * n), y = x + 1;
    system.entries.insert(
        system.entries.end(),
        {{x, x, out.information[n][0]}, {y, y, out.information[n][1]}, {x, y, cross}, {y, x, cross}});
    system.rhs[x] += gain(0) * d.xd;
    system.rhs[y] += gain(1) * d.yd;
  }
  add_edges(system, g, field, model);
  Eigen::SparseMatrix<double> matrix(size, size);
  matrix.setFromTriplets(system.entries.begin(), system.entries.end());
  const Eigen::VectorXd v = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(matrix).solve(system.rhs);
  for (std::size_t n = 0; n < nodes; ++n)
    out.correction[n] = {v[static_cast<Eigen::Index>(2 * n)], v[static_cast<Eigen::Index>(2 * n + 1)]};
  return out;
}

}  // namespace teletact::reference
