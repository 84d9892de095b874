#include "service/tissue/solid/element_shares.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

template <class T>
std::vector<double> work_of_elements(const SolidTissue& tissue, const std::vector<T>& u,
                                     const std::vector<T>& z, bool mirrored) {
  const SolidGrid& grid = tissue.grid;
  const std::size_t nx = grid.nx, nz = grid.nz, columns = grid.columns();
  using Moved = Eigen::Matrix<double, 24, Eigen::Dynamic>;  // of the elements of a line along x
  const std::size_t max_x = mirrored ? (nx + 1) / 2 : nx, max_z = mirrored ? (nz + 1) / 2 : nz;
  const auto line = static_cast<Eigen::Index>(max_x);
  Moved moved_u = Moved::Zero(24, line), moved_z = moved_u;
  const auto gather = [&](const std::vector<T>& field, std::size_t j, std::size_t k, Moved& moved) {
    for (std::size_t corner = 0; corner < 8; ++corner) {
      const std::size_t row = j + corner / 4, at = nx * ((k + corner / 2 % 2) % nz);
      for (std::size_t c = 0; c < 3; ++c) {
        auto of_corner = moved.row(static_cast<Eigen::Index>(3 * corner + c));
        if (row == grid.layers()) {  // held
          of_corner.setZero();
          continue;
        }
        const T* plane = field.data() + (3 * row + c) * columns + at;
        for (std::size_t x = 0; x < max_x; ++x)
          of_corner[static_cast<Eigen::Index>(x)] = static_cast<double>(plane[(x + corner % 2) % nx]);
      }
    }
  };
  std::vector<double> work(grid.elements());
  for (std::size_t j = 0; j < grid.layers(); ++j) {
    const HexahedronMatrix stiffness = layer_stiffness(grid, j, tissue.poisson_ratio);
    for (std::size_t k = 0; k < max_z; ++k) {
      check_cancelled();
      gather(u, j, k, moved_u);
      gather(z, j, k, moved_z);
      const std::size_t first = (j * nz + k) * nx;
      const Eigen::RowVectorXd sum = moved_z.cwiseProduct(stiffness * moved_u).colwise().sum();
      for (std::size_t x = 0; x < max_x; ++x)
        work[first + x] = tissue.youngs_modulus_pa[first + x] * sum[static_cast<Eigen::Index>(x)];
      if (!mirrored) continue;
      for (std::size_t x = 0; x < max_x; ++x) work[first + nx - 1 - x] = work[first + x];
      std::copy_n(work.begin() + static_cast<long>(first), nx,
                  work.begin() + static_cast<long>((j * nz + nz - 1 - k) * nx));
    }
  }
  return work;
}

template std::vector<double> work_of_elements(const SolidTissue&, const std::vector<float>&,
                                              const std::vector<float>&, bool);
template std::vector<double> work_of_elements(const SolidTissue&, const std::vector<double>&,
                                              const std::vector<double>&, bool);

ElementMeans::ElementMeans(const Queue& queue, const SolidGrid& grid, std::size_t at_once)
    : queue_(queue),
      layers_(grid.layers()),
      elements_(queue, grid.nx, grid.nz, grid.layers()),
      surface_(queue, grid.nx, grid.nz, at_once),
      field_(queue.array<float>(elements_.field_size())),
      spectrum_(queue.array<float>(elements_.spectrum_size())),
      plane_(queue.array<float>(surface_.field_size())),
      sum_(queue.array<float>(surface_.spectrum_size())) {}

ElementMeans::Map ElementMeans::transformed(const std::vector<float>& of_elements) {
  queue_.write(field_, of_elements.data(), of_elements.size());
  elements_.forward(field_, spectrum_, 0, layers_);
  return queue_.read(spectrum_);
}

template <class T>
ElementMeans::Map ElementMeans::shares(const SolidTissue& layers, const std::vector<T>& u,
                                       const std::vector<T>& z) {
  const std::vector<double> work = work_of_elements(layers, u, z, true);
  const double sum = std::accumulate(work.begin(), work.end(), 0.0);
  std::vector<float> shares;
  shares.reserve(work.size());
  for (const double w : work) shares.push_back(static_cast<float>(w / sum));
  return transformed(shares);
}

template ElementMeans::Map ElementMeans::shares(const SolidTissue&, const std::vector<float>&,
                                                const std::vector<float>&);
template ElementMeans::Map ElementMeans::shares(const SolidTissue&, const std::vector<double>&,
                                                const std::vector<double>&);

Eigen::VectorXd ElementMeans::means(const Map& shares, const Map& map) {
  return means({{&shares, &map}}).front();
}

std::vector<Eigen::VectorXd> ElementMeans::means(const std::vector<std::pair<const Map*, const Map*>>& all) {
  const std::size_t plane = elements_.spectrum_size() / layers_, part = plane / 2;  // real, imaginary
  std::vector<float> sums(all.size() * plane);
  using Of = Eigen::Map<const Eigen::ArrayXf>;
  const auto length = static_cast<Eigen::Index>(part);
  for (std::size_t n = 0; n < all.size(); ++n) {
    Eigen::Map<Eigen::ArrayXf> sum(sums.data() + n * plane, length),
        sum_imaginary(sums.data() + n * plane + part, length);
    for (std::size_t j = 0; j < layers_; ++j) {
      const float *map = all[n].second->data() + j * plane, *share = all[n].first->data() + j * plane;
      const Of real(map, length), imaginary(map + part, length), share_real(share, length),
          share_imaginary(share + part, length);
      sum += share_real * real + share_imaginary * imaginary;
      sum_imaginary += share_real * imaginary - share_imaginary * real;
    }
  }
  queue_.write(sum_, sums.data(), sums.size());
  surface_.backward(sum_, plane_, 0, all.size());
  const std::vector<float> means = queue_.read(plane_);
  const std::size_t nodes = elements_.field_size() / layers_;
  std::vector<Eigen::VectorXd> out;
  for (std::size_t n = 0; n < all.size(); ++n)
    out.push_back(
        Eigen::Map<const Eigen::VectorXf>(means.data() + n * nodes, static_cast<Eigen::Index>(nodes))
            .cast<double>());
  return out;
}

namespace {

// Of a round tip of 8 mm, 2 mm deep.
constexpr double kRadiusM = 0.004;
constexpr double kFineShare = 0.15;

}  // namespace

EnergyShares::Load EnergyShares::usual_load(const SolidGrid& grid) {
  std::vector<double> pressure;
  Load load;
  for (std::size_t node = 0; node < grid.columns(); ++node) {
    const auto away = [](std::size_t n, std::size_t period, double spacing_m) {
      return static_cast<double>(std::min(n, period - n)) * spacing_m;
    };
    const double r = std::hypot(away(node % grid.nx, grid.nx, grid.spacing_x_m),
                                away(node / grid.nx, grid.nz, grid.spacing_z_m));
    if (r >= kRadiusM) continue;
    load.unknowns.push_back(grid.columns() + node);
    pressure.push_back(std::sqrt(1 - r * r / (kRadiusM * kRadiusM)));
  }
  load.force_n =
      Eigen::Map<const Eigen::VectorXd>(pressure.data(), static_cast<Eigen::Index>(pressure.size()));
  return load;
}

EnergyShares::EnergyShares(const Queue& queue, const SolidGrid& grid, const LayeredTissue& tissue,
                           double poisson_ratio, const std::vector<double>& u)
    : columns_(grid.columns()),
      layers_pa_(tissue.youngs_modulus_pa),
      means_(queue, grid),
      shares_(means_.shares(solid_of(grid, tissue, poisson_ratio), u, u)) {}

FeltModulus EnergyShares::felt(const SolidTissue& tissue, double softer) {
  std::vector<float> logarithm(tissue.youngs_modulus_pa.size()), stiffer(logarithm), weaker(logarithm);
  for (std::size_t e = 0; e < logarithm.size(); ++e) {
    const double ratio = softer * tissue.youngs_modulus_pa[e] / layers_pa_[e / columns_];
    logarithm[e] = static_cast<float>(std::log(ratio));
    stiffer[e] = static_cast<float>(ratio - 1);
    weaker[e] = static_cast<float>(1 / ratio - 1);
  }
  FeltModulus out;
  const auto mean = [&](const std::vector<float>& map) {
    return means_.means(shares_, means_.transformed(map));
  };
  const Eigen::ArrayXd m = mean(logarithm), stiff = mean(stiffer), weak = mean(weaker);
  out.scale = (-m / 2).exp();
  out.beyond = ((1 + weak) * m.exp() - 1).max(1 - (-m).exp() / (1 + stiff)).max(0.0);
  // Finer forces than what D scales are left as they were: that share of a contact's energy, about.
  out.beyond.array() += kFineShare * (out.scale.array().square() - 1).abs();
  if (!out.scale.allFinite() || !out.beyond.allFinite())
    throw std::domain_error("solid: how it is felt at the surface is not finite");
  return out;
}

namespace {

// Of the contacts: each about 1.6 times as wide as the one before. Between them shares change little.
constexpr double kRadii[] = {0.001, 0.0016, 0.0025, 0.004, 0.0063, 0.010};

// Cubic through values one apart, from the second (t = 0) to the third: weights of the values, of their first
// and second derivatives by t (Catmull and Rom).
struct Cubic {
  std::array<double, 4> value, slope, curvature;
  explicit Cubic(double t)
      : value{t * (-0.5 + t * (1 - 0.5 * t)), 1 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2 - 1.5 * t)),
              t * t * (-0.5 + 0.5 * t)},
        slope{-0.5 + t * (2 - 1.5 * t), t * (-5 + 4.5 * t), 0.5 + t * (4 - 4.5 * t), t * (-1 + 1.5 * t)},
        curvature{2 - 3 * t, -5 + 9 * t, 4 - 9 * t, -1 + 3 * t} {}
};

// Share of a node's part of the surface, spacing_x x spacing_z about it, that bears density(r / radius).
template <class F>
double borne(double x_m, double z_m, const SolidGrid& grid, double radius_m, const F& density) {
  constexpr int kParts = 16;
  double sum = 0;
  for (int k = 0; k < kParts; ++k)
    for (int i = 0; i < kParts; ++i) {
      const double x = x_m + ((i + 0.5) / kParts - 0.5) * grid.spacing_x_m;
      const double z = z_m + ((k + 0.5) / kParts - 0.5) * grid.spacing_z_m;
      const double r = std::hypot(x, z) / radius_m;
      if (r < 1) sum += density(r);
    }
  return sum;
}

}  // namespace

FeltForce::FeltForce(const SolidGrid& grid, std::vector<double> radius_m,
                     std::vector<Eigen::VectorXd> log_mean, std::vector<Eigen::VectorXd> log_variance)
    : nx_(grid.nx),
      nz_(grid.nz),
      spacing_x_m_(grid.spacing_x_m),
      spacing_z_m_(grid.spacing_z_m),
      log_radius_(std::move(radius_m)),
      mean_(std::move(log_mean)),
      variance_(std::move(log_variance)) {
  for (double& a : log_radius_) a = std::log(a);
}

double FeltForce::max_log_variance(double radius_m) const {
  const auto above = static_cast<std::size_t>(std::ranges::lower_bound(log_radius_, std::log(radius_m)) -
                                              log_radius_.begin());
  const std::size_t last = log_radius_.size() - 1;
  return std::max(
      {0.0, variance_[std::min(above, last)].maxCoeff(), variance_[above > 0 ? above - 1 : 0].maxCoeff()});
}

FeltForce::At FeltForce::at(double x_m, double z_m, double radius_m) const {
  const auto last = static_cast<long>(log_radius_.size()) - 1;
  const double log_a = std::clamp(std::log(radius_m), log_radius_.front(), log_radius_.back());
  const long n =
      std::clamp(std::ranges::upper_bound(log_radius_, log_a) - log_radius_.begin() - 1, 0L, last - 1);
  const auto at_n = [&](long m) { return log_radius_[static_cast<std::size_t>(m)]; };
  const double width = at_n(n + 1) - at_n(n);
  const Cubic over_a((log_a - at_n(n)) / width);
  const double i = x_m / spacing_x_m_, k = z_m / spacing_z_m_;
  const Cubic over_x(i - std::floor(i)), over_z(k - std::floor(k));
  const auto column = [](double at, long offset, std::size_t period) {
    const auto n_period = static_cast<long>(period);
    const long c = (static_cast<long>(std::floor(at)) - 1 + offset) % n_period;
    return static_cast<Eigen::Index>(c < 0 ? c + n_period : c);
  };
  At out;
  for (long q = 0; q < 4; ++q) {
    const auto radius = static_cast<std::size_t>(std::clamp(n - 1 + q, 0L, last));
    const auto q_at = static_cast<std::size_t>(q);
    const double of_a = over_a.value[q_at], by_a = over_a.slope[q_at] / width;
    for (std::size_t z = 0; z < 4; ++z)
      for (std::size_t x = 0; x < 4; ++x) {
        const Eigen::Index node = column(i, static_cast<long>(x), nx_) +
                                  static_cast<Eigen::Index>(nx_) * column(k, static_cast<long>(z), nz_);
        const double m = mean_[radius][node];
        const double here = over_x.value[x] * over_z.value[z];
        out.log_mean += of_a * here * m;
        out.by_log_radius += by_a * here * m;
        out.log_variance += of_a * here * variance_[radius][node];
        out.slope[0] += of_a * over_x.slope[x] * over_z.value[z] * m / spacing_x_m_;
        out.slope[1] += of_a * over_x.value[x] * over_z.slope[z] * m / spacing_z_m_;
        out.curvature(0, 0) +=
            of_a * over_x.curvature[x] * over_z.value[z] * m / (spacing_x_m_ * spacing_x_m_);
        out.curvature(1, 1) +=
            of_a * over_x.value[x] * over_z.curvature[z] * m / (spacing_z_m_ * spacing_z_m_);
        out.curvature(0, 1) += of_a * over_x.slope[x] * over_z.slope[z] * m / (spacing_x_m_ * spacing_z_m_);
      }
  }
  out.curvature(1, 0) = out.curvature(0, 1);
  out.log_variance = std::max(0.0, out.log_variance);
  return out;
}

std::vector<double> ForceShares::radii_m(const SolidGrid& grid) {
  const double most = std::min(static_cast<double>(grid.nx) * grid.spacing_x_m,
                               static_cast<double>(grid.nz) * grid.spacing_z_m) /
                      4;
  std::vector<double> radii;
  for (const double a : kRadii)
    if (radii.size() < 2 || a <= most) radii.push_back(a);
  return radii;
}

ForceShares::Contact ForceShares::contact(const SolidGrid& grid, double radius_m) {
  Contact out;
  std::vector<double> hertz, punch;
  for (std::size_t node = 0; node < grid.columns(); ++node) {
    const auto away = [](std::size_t n, std::size_t period, double spacing_m) {
      return (n <= period / 2 ? static_cast<double>(n)
                              : static_cast<double>(n) - static_cast<double>(period)) *
             spacing_m;
    };
    const double x = away(node % grid.nx, grid.nx, grid.spacing_x_m),
                 z = away(node / grid.nx, grid.nz, grid.spacing_z_m);
    if (std::hypot(x, z) > radius_m + std::hypot(grid.spacing_x_m, grid.spacing_z_m)) continue;
    const double of_hertz = borne(x, z, grid, radius_m, [](double r) { return std::sqrt(1 - r * r); });
    const double of_punch = borne(x, z, grid, radius_m, [](double r) { return 1 / std::sqrt(1 - r * r); });
    if (of_hertz <= 0) continue;
    out.unknowns.push_back(grid.columns() + node);
    hertz.push_back(of_hertz), punch.push_back(of_punch);
  }
  const auto unit = [](const std::vector<double>& f) {
    const Eigen::Map<const Eigen::VectorXd> all(f.data(), static_cast<Eigen::Index>(f.size()));
    return Eigen::VectorXd(all / all.sum());
  };
  out.hertz_n = unit(hertz), out.punch_n = unit(punch);
  return out;
}

ForceShares::ForceShares(const Queue& queue, const SolidGrid& grid, const LayeredTissue& tissue,
                         double poisson_ratio, const Solve& solve)
    : grid_(grid),
      layers_pa_(tissue.youngs_modulus_pa),
      radius_m_(radii_m(grid)),
      means_(queue, grid, 2 * radius_m_.size()) {
  const SolidTissue layers = solid_of(grid, tissue, poisson_ratio);
  for (const double radius : radius_m_) {
    const Contact pressed = contact(grid, radius);
    const std::vector<float> u = solve(pressed.unknowns, pressed.hertz_n),
                             z = solve(pressed.unknowns, pressed.punch_n);
    shares_.push_back(means_.shares(layers, u, z));
  }
}

FeltForce ForceShares::felt(const SolidTissue& tissue, double softer) {
  std::vector<float> logarithm(tissue.youngs_modulus_pa.size()), square(logarithm.size());
  const auto columns = static_cast<Eigen::Index>(grid_.columns());
  for (std::size_t j = 0; j < layers_pa_.size(); ++j) {
    const std::size_t first = j * grid_.columns();
    const Eigen::Map<const Eigen::ArrayXd> pa(tissue.youngs_modulus_pa.data() + first, columns);
    Eigen::Map<Eigen::ArrayXf> to(logarithm.data() + first, columns);
    to = (softer / layers_pa_[j] * pa).cast<float>();
    to = to.log();
    Eigen::Map<Eigen::ArrayXf>(square.data() + first, columns) = to.square();
  }
  const ElementMeans::Map of_logarithm = means_.transformed(logarithm),
                          of_square = means_.transformed(square);
  std::vector<std::pair<const ElementMeans::Map*, const ElementMeans::Map*>> all;
  for (const ElementMeans::Map& shares : shares_) all.emplace_back(&shares, &of_logarithm);
  for (const ElementMeans::Map& shares : shares_) all.emplace_back(&shares, &of_square);
  std::vector<Eigen::VectorXd> mean = means_.means(all), variance;
  for (std::size_t r = 0; r < shares_.size(); ++r)
    variance.push_back(mean[shares_.size() + r] - mean[r].cwiseAbs2());
  mean.resize(shares_.size());
  return {grid_, radius_m_, std::move(mean), std::move(variance)};
}

}  // namespace teletact::service
