#include "service/imaging/modulus/cell_strains.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kLargestNoise = 0.7;  // of the strain: with more a cell tells nothing
constexpr double kMinPart = 0.5;       // of a cell's nodes that must be measured
constexpr double kColumnsPerStep = 0.3, kMostOfColumns = 0.06;  // of what columns differ by, in a step

// Weights of the kernel's cells from the middle one on: the slope of a least-squares line weighs strain by a
// parabola along the slope, and evenly across.
std::vector<double> kernel(double length_m, double cell_m, bool along) {
  const double half = length_m / 2;
  const auto integral = [&](double t) {
    t = std::clamp(t, -half, half);
    return along ? t - t * t * t / (3 * half * half) : t;
  };
  std::vector<double> weights;
  for (double t = -cell_m / 2; t < half; t += cell_m) weights.push_back(integral(t + cell_m) - integral(t));
  return weights;
}

VectorXd weighted(const VectorXd& in, const CellGrid& cells, const std::vector<double>& weights, bool down) {
  const auto nx = static_cast<Index>(cells.columns), ny = static_cast<Index>(cells.rows);
  const auto reach = static_cast<Index>(weights.size()) - 1;
  VectorXd out(in.size());
  for (Index j = 0; j < ny; ++j)
    for (Index i = 0; i < nx; ++i) {
      double sum = 0, of_weights = 0;
      for (Index k = -reach; k <= reach; ++k) {
        const Index a = down ? i : i + k, b = down ? j + k : j;
        if (a < 0 || a >= nx || b < 0 || b >= ny) continue;
        const double weight = weights[static_cast<std::size_t>(std::abs(k))];
        sum += weight * in[a + nx * b], of_weights += weight;
      }
      out[i + nx * j] = sum / of_weights;
    }
  return out;
}

constexpr double kNearFieldM = 3e-3;    // what the face's condition decides, not the modulus
constexpr double kTold = 0.4;           // of the median modelled strain: with less a cell tells no modulus
constexpr double kStandoffM = 4e-3;     // of the image without a trusted strain: less is the kernels'
constexpr double kTrackedFromM = 1e-3;  // depth below the face where tracking begins; as far from its end

}  // namespace

namespace {

bool tracked_over_half(const Measured& m, std::size_t row) {
  std::size_t tracked = 0;
  for (std::size_t i = 0; i < m.grid.nx; ++i) tracked += m.strain_valid[i + m.grid.nx * row];
  return 2 * tracked >= m.grid.nx;
}

}  // namespace

double top_of(const Measured& m) {
  for (std::size_t j = 0; j < m.grid.ny; ++j) {
    if (!tracked_over_half(m, j)) continue;
    const double y_m = m.grid.y_m(m.grid.nx * j);
    return y_m - std::max(m.grid.origin_y_m, 0.0) < kStandoffM ? 0 : y_m - kTrackedFromM;
  }
  throw NoCompression("no depth of the image was tracked over half of its width; press further");
}

double bottom_of(const Measured& m) {
  const double end_m = m.grid.y_m(m.grid.size() - 1) + m.grid.dy_m / 2;
  for (std::size_t j = m.grid.ny; j-- > 0;) {
    if (!tracked_over_half(m, j)) continue;
    const double y_m = m.grid.y_m(m.grid.nx * j);
    return end_m - y_m < kStandoffM ? end_m : y_m + kTrackedFromM;
  }
  return end_m;
}

void leave_out(const VectorXd& log_strain, const CellGrid& cells, double pad_m, double edge_m,
               VectorXd& observed) {
  std::vector<double> values(log_strain.begin(), log_strain.end());
  const double told = std::log(kTold) + median(values);
  for (Index c = 0; c < observed.size(); ++c)
    if (const double y_m = cells.y_m(static_cast<std::size_t>(c));
        y_m < kNearFieldM || std::abs(y_m - pad_m) < edge_m || log_strain[c] < told)
      observed[c] = 0;
  if (!(observed.maxCoeff() > 0))
    throw NoCompression("no cell of the strain map tells a modulus; press further between the frames");
}

double level_of(const VectorXd& of_cells, const VectorXd& observed) {
  std::vector<double> values;
  for (Index c = 0; c < of_cells.size(); ++c)
    if (observed[c] > 0) values.push_back(of_cells[c]);
  return median(values);
}

CellStrains cell_strains(const Measured& m, const CellGrid& cells, double top_m, double sign) {
  const auto size = static_cast<Index>(cells.size());
  VectorXd sum = VectorXd::Zero(size), squares = sum, count = sum, nodes = sum;
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    if (n % m.grid.nx == 0) check_cancelled();
    const double i = (m.grid.x_m(n) - cells.first_x_m) / cells.spacing_m + 0.5,
                 j = (m.grid.y_m(n) - top_m) / cells.row_m;
    if (!(i >= 0 && j >= 0 && i < static_cast<double>(cells.columns) && j < static_cast<double>(cells.rows)))
      continue;
    const auto cell =
        static_cast<Index>(static_cast<std::size_t>(i) + cells.columns * static_cast<std::size_t>(j));
    ++nodes[cell];
    if (!m.strain_valid[n]) continue;
    sum[cell] += sign * m.axial_strain[n], ++count[cell];
    squares[cell] += std::pow(m.axial_strain_noise[n], 2);
  }
  CellStrains out{VectorXd::Zero(size), VectorXd::Zero(size), VectorXd::Zero(size)};
  for (Index c = 0; c < size; ++c) {
    if (!(count[c] > 0 && count[c] >= kMinPart * nodes[c])) continue;
    const double strain = sum[c] / count[c], deviation = std::sqrt(squares[c] / count[c]);
    if (!(strain > 0 && deviation < kLargestNoise * strain)) continue;
    out.log_strain[c] = std::log(strain), out.deviation[c] = deviation / strain, out.observed[c] = 1;
  }
  return out;
}

VectorXd as_measured(const VectorXd& strain, const CellGrid& cells, const StrainOptions& options) {
  return weighted(weighted(strain, cells, kernel(options.kernel_axial_m, cells.row_m, true), true), cells,
                  kernel(options.kernel_lateral_m, cells.spacing_m, false), false);
}

double at_node(const VectorXd& of_cells, const CellGrid& cells, const ImageGrid& image, double top_m,
               std::size_t n) {
  const auto place = [](double at, std::size_t count) {
    return std::clamp(at, 0.0, static_cast<double>(count - 1));
  };
  const double x = place((image.x_m(n) - cells.first_x_m) / cells.spacing_m, cells.columns),
               y = place((image.y_m(n) - top_m) / cells.row_m - 0.5, cells.rows);
  const auto i = std::min(static_cast<std::size_t>(x), cells.columns - 2),
             j = std::min(static_cast<std::size_t>(y), cells.rows - 2);
  const double s = x - static_cast<double>(i), t = y - static_cast<double>(j);
  const auto at = [&](std::size_t a, std::size_t b) {
    return of_cells[static_cast<Index>(i + a + cells.columns * (j + b))];
  };
  return (1 - t) * ((1 - s) * at(0, 0) + s * at(1, 0)) + t * ((1 - s) * at(0, 1) + s * at(1, 1));
}

double alike_m2(const VectorXd& left, const CellGrid& cells, double scale) {
  constexpr Index kReach = 5;  // cells
  const auto columns = static_cast<Index>(cells.columns), rows = static_cast<Index>(cells.rows);
  const VectorXd limited = left.cwiseMax(-2 * scale).cwiseMin(2 * scale);
  double sum = 0;
  for (Index j = -kReach; j <= kReach; ++j)
    for (Index i = -kReach; i <= kReach; ++i) {
      double products = 0;
      for (Index b = std::max<Index>(0, -j); b < std::min(rows, rows - j); ++b)
        for (Index a = std::max<Index>(0, -i); a < std::min(columns, columns - i); ++a)
          products += limited[a + columns * b] * limited[a + i + columns * (b + j)];
      sum += std::max(0.0, products / limited.squaredNorm());
    }
  return sum * cells.spacing_m * cells.row_m;
}

void hold_columns(VectorXd& log_modulus, const CellGrid& cells) {
  const auto columns = static_cast<Index>(cells.columns), rows = static_cast<Index>(cells.rows);
  VectorXd typical(columns);
  std::vector<double> values(cells.rows);
  for (Index i = 0; i < columns; ++i) {
    for (Index j = 0; j < rows; ++j) values[static_cast<std::size_t>(j)] = log_modulus[i + columns * j];
    typical[i] = median(values);
  }
  typical.array() -= typical.mean();
  log_modulus -=
      (kColumnsPerStep * typical).cwiseMax(-kMostOfColumns).cwiseMin(kMostOfColumns).replicate(rows, 1);
}

}  // namespace teletact::service
