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

// Nodes from one to another, by the nearest of the period's copies.
long nearest(std::size_t to, std::size_t from, std::size_t n) {
  const auto size = static_cast<long>(n), away = static_cast<long>(to) - static_cast<long>(from);
  const long ahead = away < 0 ? away + size : away;
  return 2 * ahead > size ? ahead - size : ahead;
}

struct SurfacePlace {
  std::size_t component, x, z;
};
std::vector<SurfacePlace> places_of(const std::vector<std::size_t>& unknowns, std::size_t nx,
                                    std::size_t nz) {
  std::vector<SurfacePlace> places;
  places.reserve(unknowns.size());
  for (const std::size_t unknown : unknowns) {
    const std::size_t node = unknown % (nx * nz);
    places.push_back({unknown / (nx * nz), node % nx, node / nx});
  }
  return places;
}

}  // namespace

SurfaceCompliance::SurfaceCompliance(std::size_t nx, std::size_t nz, const std::vector<double>& symbol,
                                     std::size_t pitch, std::size_t max_x, std::size_t max_z)
    : max_x_(max_x), max_z_(max_z), table_(6 * (max_x + 1) * (max_z + 1), 0.0) {
  const std::size_t half_x = nx / 2, half_z = nz / 2;
  const std::vector<Turn> along_x = turns(nx), along_z = turns(nz);
  std::vector<double> half((max_x + 1) * (half_z + 1));
  for (std::size_t e = 0; e < 6; ++e) {
    for (std::size_t kz = 0; kz <= half_z; ++kz)
      for (std::size_t i = 0; i <= max_x; ++i) {
        double sum = 0;
        for (std::size_t kx = 0; kx <= half_x; ++kx) {
          const Turn& turn = along_x[kx * i % nx];
          sum += (kx == 0 || 2 * kx == nx ? 1 : 2) * symbol[(e * (half_z + 1) + kz) * pitch + kx] *
                 (kOddX[e] ? turn.sine : turn.cosine);
        }
        half[kz * (max_x + 1) + i] = sum;
      }
    for (std::size_t k = 0; k <= max_z; ++k)
      for (std::size_t kz = 0; kz <= half_z; ++kz) {
        const Turn& turn = along_z[kz * k % nz];
        const double share = kSign[e] * (kz == 0 || 2 * kz == nz ? 1 : 2) *
                             (kOddZ[e] ? turn.sine : turn.cosine) / static_cast<double>(nx * nz);
        for (std::size_t i = 0; i <= max_x; ++i)
          table_[(e * (max_z + 1) + k) * (max_x + 1) + i] += share * half[kz * (max_x + 1) + i];
      }
  }
}

double SurfaceCompliance::operator()(std::size_t p, std::size_t q, long dx, long dz) const {
  const std::size_t entry = kEntry[p][q];
  const auto i = static_cast<std::size_t>(std::labs(dx)), k = static_cast<std::size_t>(std::labs(dz));
  const bool turned = (p > q && (p == 1 || q == 1)) != ((kOddX[entry] && dx < 0) != (kOddZ[entry] && dz < 0));
  const double value = table_[(entry * (max_z_ + 1) + k) * (max_x_ + 1) + i];
  return turned ? -value : value;
}

Eigen::MatrixXd SurfaceCompliance::among(const std::vector<std::size_t>& unknowns, std::size_t nx,
                                         std::size_t nz) const {
  const std::vector<SurfacePlace> places = places_of(unknowns, nx, nz);
  const auto n = static_cast<Eigen::Index>(unknowns.size());
  Eigen::MatrixXd s(n, n);
  for (Eigen::Index b = 0; b < n; ++b) {
    const SurfacePlace from = places[static_cast<std::size_t>(b)];
    for (Eigen::Index a = b; a < n; ++a) {
      const SurfacePlace to = places[static_cast<std::size_t>(a)];
      s(a, b) = s(b, a) =
          (*this)(to.component, from.component, nearest(to.x, from.x, nx), nearest(to.z, from.z, nz));
    }
  }
  return s;
}

Eigen::MatrixXd SurfaceCompliance::between(const std::vector<std::size_t>& moved,
                                           const std::vector<std::size_t>& pushed, std::size_t nx,
                                           std::size_t nz) const {
  const std::vector<SurfacePlace> to = places_of(moved, nx, nz), from = places_of(pushed, nx, nz);
  Eigen::MatrixXd s(moved.size(), pushed.size());
  for (std::size_t b = 0; b < from.size(); ++b)
    for (std::size_t a = 0; a < to.size(); ++a)
      s(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(b)) =
          (*this)(to[a].component, from[b].component, nearest(to[a].x, from[b].x, nx),
                  nearest(to[a].z, from[b].z, nz));
  return s;
}

Eigen::VectorXd SurfaceCompliance::times(const std::vector<std::size_t>& unknowns,
                                         const Eigen::VectorXd& force_n, std::size_t nx, std::size_t nz,
                                         std::size_t first, std::size_t count) const {
  const std::size_t columns = nx * nz;
  Eigen::VectorXd out = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(count * columns));
  for (std::size_t u = 0; u < unknowns.size(); ++u) {
    const std::size_t from = unknowns[u], q = from / columns;
    const double force = force_n[static_cast<Eigen::Index>(u)];
    for (std::size_t p = first; p < first + count; ++p)
      for (std::size_t k = 0; k < nz; ++k) {
        const long dz = nearest(k, from % columns / nx, nz);
        double* row = out.data() + ((p - first) * nz + k) * nx;
        for (std::size_t i = 0; i < nx; ++i) row[i] += force * (*this)(p, q, nearest(i, from % nx, nx), dz);
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
  return {wide.nx, wide.nz, symbol, pitch, grid.nx / 2, grid.nz / 2};
}

}  // namespace teletact::service
