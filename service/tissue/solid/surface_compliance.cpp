#include "service/tissue/solid/surface_compliance.h"

#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <stdexcept>

#include "service/tissue/solid/layered_factor.h"

namespace teletact::service {
namespace {

// Every entry of the compliance is even or odd in x and in z: [xx, xy, xz, yy, yz, zz].
constexpr std::array<bool, 6> kOddX{false, true, true, false, false, false};
constexpr std::array<bool, 6> kOddZ{false, false, true, false, true, false};
// Its transform is real in a basis in which u_y is multiplied with -i: what that and the sines leave.
constexpr std::array<double, 6> kSign{1, 1, -1, 1, -1, 1};
constexpr std::array<std::array<std::size_t, 3>, 3> kEntry{{{0, 1, 2}, {1, 3, 4}, {2, 4, 5}}};

struct Turn {
  double cosine, sine;
};
std::vector<Turn> turns(std::size_t n) {
  std::vector<Turn> out(n);
  for (std::size_t i = 0; i < n; ++i) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(n);
    out[i] = {std::cos(angle), std::sin(angle)};
  }
  return out;
}

// `step` further around a period of n: a division for each wave number would take most of the time.
std::size_t after(std::size_t at, std::size_t step, std::size_t n) {
  return at + step < n ? at + step : at + step - n;
}

// Nodes from one to another, by the nearest of the period's copies.
long nearest(std::size_t to, std::size_t from, std::size_t n) {
  const auto size = static_cast<long>(n), away = static_cast<long>(to) - static_cast<long>(from);
  const long ahead = away < 0 ? away + size : away;
  return 2 * ahead > size ? ahead - size : ahead;
}

}  // namespace

struct SurfaceCompliance::Place {
  std::size_t component, x, z;
};

SurfaceCompliance::SurfaceCompliance(std::size_t nx, std::size_t nz, const std::vector<double>& symbol,
                                     std::size_t pitch, std::size_t wide_x, std::size_t wide_z)
    : nx_(nx), nz_(nz), table_(6 * (nx / 2 + 1) * (nz / 2 + 1), 0.0) {
  const std::size_t max_x = nx / 2, max_z = nz / 2, half_x = wide_x / 2, half_z = wide_z / 2;
  const std::vector<Turn> along_x = turns(wide_x), along_z = turns(wide_z);
  std::vector<double> half((max_x + 1) * (half_z + 1));
  for (std::size_t e = 0; e < 6; ++e) {
    for (std::size_t kz = 0; kz <= half_z; ++kz)
      for (std::size_t i = 0; i <= max_x; ++i) {
        double sum = 0;
        for (std::size_t kx = 0, at = 0; kx <= half_x; ++kx, at = after(at, i, wide_x)) {
          const Turn& turn = along_x[at];
          sum += (kx == 0 || 2 * kx == wide_x ? 1 : 2) * symbol[(e * (half_z + 1) + kz) * pitch + kx] *
                 (kOddX[e] ? turn.sine : turn.cosine);
        }
        half[kz * (max_x + 1) + i] = sum;
      }
    for (std::size_t k = 0; k <= max_z; ++k)
      for (std::size_t kz = 0, at = 0; kz <= half_z; ++kz, at = after(at, k, wide_z)) {
        const Turn& turn = along_z[at];
        const double share = kSign[e] * (kz == 0 || 2 * kz == wide_z ? 1 : 2) *
                             (kOddZ[e] ? turn.sine : turn.cosine) / static_cast<double>(wide_x * wide_z);
        for (std::size_t i = 0; i <= max_x; ++i)
          table_[(e * (max_z + 1) + k) * (max_x + 1) + i] += share * half[kz * (max_x + 1) + i];
      }
  }
}

double SurfaceCompliance::operator()(std::size_t p, std::size_t q, long dx, long dz) const {
  const std::size_t entry = kEntry[p][q];
  const auto i = static_cast<std::size_t>(std::labs(dx)), k = static_cast<std::size_t>(std::labs(dz));
  const bool turned = (p > q && (p == 1 || q == 1)) != ((kOddX[entry] && dx < 0) != (kOddZ[entry] && dz < 0));
  const double value = table_[(entry * (nz_ / 2 + 1) + k) * (nx_ / 2 + 1) + i];
  return turned ? -value : value;
}

std::vector<SurfaceCompliance::Place> SurfaceCompliance::places_of(
    const std::vector<std::size_t>& unknowns) const {
  std::vector<Place> places;
  places.reserve(unknowns.size());
  for (const std::size_t unknown : unknowns) {
    const std::size_t node = unknown % (nx_ * nz_);
    places.push_back({unknown / (nx_ * nz_), node % nx_, node / nx_});
  }
  return places;
}

double SurfaceCompliance::between(const Place& moved, const Place& pushed) const {
  return (*this)(moved.component, pushed.component, nearest(moved.x, pushed.x, nx_),
                 nearest(moved.z, pushed.z, nz_));
}

Eigen::MatrixXd SurfaceCompliance::among(const std::vector<std::size_t>& unknowns) const {
  const std::vector<Place> places = places_of(unknowns);
  Eigen::MatrixXd s(unknowns.size(), unknowns.size());
  for (std::size_t b = 0; b < places.size(); ++b)
    for (std::size_t a = b; a < places.size(); ++a) {
      const auto i = static_cast<Eigen::Index>(a), j = static_cast<Eigen::Index>(b);
      s(i, j) = s(j, i) = between(places[a], places[b]);
    }
  return s;
}

Eigen::MatrixXd SurfaceCompliance::between(const std::vector<std::size_t>& moved,
                                           const std::vector<std::size_t>& pushed) const {
  const std::vector<Place> to = places_of(moved), from = places_of(pushed);
  Eigen::MatrixXd s(moved.size(), pushed.size());
  for (std::size_t b = 0; b < from.size(); ++b)
    for (std::size_t a = 0; a < to.size(); ++a)
      s(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) = between(to[a], from[b]);
  return s;
}

Eigen::VectorXd SurfaceCompliance::times(const std::vector<std::size_t>& unknowns,
                                         const Eigen::VectorXd& force_n, std::size_t first,
                                         std::size_t count) const {
  const std::vector<Place> pushed = places_of(unknowns);
  Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(count * nx_ * nz_));
  for (std::size_t u = 0; u < unknowns.size(); ++u) {
    const double force = force_n[static_cast<Eigen::Index>(u)];
    double* to = out.data();
    for (std::size_t p = first; p < first + count; ++p)
      for (std::size_t k = 0; k < nz_; ++k) {
        const long dz = nearest(k, pushed[u].z, nz_);
        for (std::size_t i = 0; i < nx_; ++i)
          *to++ += force * (*this)(p, pushed[u].component, nearest(i, pushed[u].x, nx_), dz);
      }
  }
  return out;
}

SurfaceCompliance wide_surface(const SolidGrid& grid, const LayeredTissue& tissue, double poisson_ratio,
                               double min_period_m, double smooth_m, std::size_t row) {
  SolidGrid wide = grid;
  const auto widened = [&](std::size_t n, double spacing_m) {
    std::size_t wanted = n;
    while (static_cast<double>(wanted) * spacing_m < min_period_m) wanted *= 2;
    return wanted;
  };
  wide.nx = widened(grid.nx, grid.spacing_x_m);
  if (grid.nz > 1) wide.nz = widened(grid.nz, grid.spacing_z_m);
  const std::size_t pitch = wide.nx / 2 + 1;
  std::vector<double> symbol = row_symbol(wide, tissue, poisson_ratio, pitch, row);
  const auto left = [&](std::size_t k, std::size_t n, double spacing_m) {
    const double smeared =
        2 * std::numbers::pi * static_cast<double>(k) * smooth_m / (static_cast<double>(n) * spacing_m);
    return std::exp(-smeared * smeared / 2);
  };
  for (std::size_t e = 0; e < 6; ++e)
    for (std::size_t kz = 0; kz <= wide.nz / 2; ++kz)
      for (std::size_t kx = 0; kx <= wide.nx / 2; ++kx)
        symbol[(e * (wide.nz / 2 + 1) + kz) * pitch + kx] *=
            left(kx, wide.nx, wide.spacing_x_m) * left(kz, wide.nz, wide.spacing_z_m);
  return {grid.nx, grid.nz, symbol, pitch, wide.nx, wide.nz};
}

}  // namespace teletact::service
