// Stages and kernels against plain code in double (tests/reference), in float and in double.
#include <Eigen/SparseCholesky>
#include <cmath>
#include <complex>
#include <cstdio>
#include <limits>
#include <numbers>
#include <random>

#include "bench/basics/median.h"
#include "bench/phantoms/metrics.h"
#include "bench/solid_blocks.h"
#include "bench/suites/device/device.h"
#include "service/imaging/tracking/b_mode.h"
#include "service/imaging/tracking/measured.h"
#include "service/solver/fourier.h"
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/solid/solid_solver.h"
#include "tests/reference/b_mode.h"
#include "tests/reference/elasticity.h"
#include "tests/reference/solid.h"
#include "tests/reference/strain.h"

namespace teletact::bench {
namespace {

using Eigen::VectorXd;

// In roundings of the precision: what the tests of these kernels allow.
constexpr double kOperatorRoundings = 20, kFourierRoundings = 8;

template <class T>
constexpr const char* kName = std::is_same_v<T, float> ? "float" : "double";

void say(DevicePart& part, ReferenceFigures f) {
  f.met = f.off <= f.bound;  // NaN is not
  part.add("references", f);
  std::printf("%-40s %-8s off by %.1e, at most %.1e%s\n", f.stage.c_str(), f.precision.c_str(), f.off,
              f.bound, f.met ? "" : "  NOT MET");
}

std::vector<double> drawn(std::size_t count) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<double> values(count);
  for (double& value : values) value = uniform(random);
  return values;
}

template <class T>
void check_operator(DevicePart& part, const service::Queue& queue) {
  const reference::TouchedTissue window = scene_window();
  const service::TissueGrid& grid = window.grid;
  constexpr double kUnitPa = 1e4;
  service::Elasticity<T> k(queue,
                           {grid, window.material, kUnitPa, std::vector<std::uint8_t>(grid.dofs(), 1)});
  const std::vector<double> u = drawn(grid.dofs());
  auto y = queue.array<T>(u.size());
  k.apply_unconstrained(queue.array(std::vector<T>(u.begin(), u.end())), y, 1);
  const VectorXd wanted = reference::assemble(grid, window.material) *
                          Eigen::Map<const VectorXd>(u.data(), Eigen::Index(u.size())) / kUnitPa;
  const std::vector<T> host = queue.read(y);
  const VectorXd found =
      Eigen::Map<const Eigen::VectorX<T>>(host.data(), wanted.size()).template cast<double>();
  say(part, {"plane stiffness, 123 x 34 nodes", kName<T>,
             (found - wanted).lpNorm<Eigen::Infinity>() / wanted.lpNorm<Eigen::Infinity>(),
             kOperatorRoundings * std::numeric_limits<T>::epsilon()});
}

template <class T>
void check_fourier(DevicePart& part, const service::Queue& queue) {
  constexpr std::size_t kX = 32, kZ = 16, kPlanes = 3;
  service::Fourier<T> fourier(queue, kX, kZ, kPlanes);
  const std::vector<double> field = drawn(fourier.field_size());
  auto there = queue.array(std::vector<T>(field.begin(), field.end()));
  auto spectrum = queue.array<T>(fourier.spectrum_size());
  fourier.forward(there, spectrum, 0, kPlanes);
  const std::vector<T> found = queue.read(spectrum);
  double off = 0;
  for (std::size_t plane = 0; plane < kPlanes; ++plane)
    for (std::size_t kz = 0; kz < kZ; ++kz)
      for (std::size_t kx = 0; kx <= kX / 2; ++kx) {
        using Long = long double;  // in double the plain sum would be off by as much
        std::complex<Long> sum = 0;
        for (std::size_t z = 0; z < kZ; ++z)
          for (std::size_t x = 0; x < kX; ++x)
            sum += Long(field[(plane * kZ + z) * kX + x]) *
                   std::polar(Long(1), -2 * std::numbers::pi_v<Long> *
                                           (Long(kx * x % kX) / kX + Long(kz * z % kZ) / kZ));
        const std::size_t at = (2 * plane * kZ + kz) * fourier.pitch() + kx;
        off = std::max(
            off, double(std::abs(std::complex<Long>(found[at], found[at + kZ * fourier.pitch()]) - sum)));
      }
  say(part, {"Fourier transform, 32 x 16", kName<T>, off / std::sqrt(double(kX * kZ)),
             kFourierRoundings * std::numeric_limits<T>::epsilon()});
  fourier.backward(spectrum, there, 0, kPlanes);
  const std::vector<T> back = queue.read(there);
  off = 0;
  for (std::size_t n = 0; n < back.size(); ++n) off = std::max(off, std::abs(double(back[n]) - field[n]));
  say(part, {"Fourier transform, 32 x 16, and back", kName<T>, off,
             kFourierRoundings * std::numeric_limits<T>::epsilon()});
}

// The force on a pushed patch, in the norm of its compliance.
template <class T>
void check_solid(DevicePart& part, const service::Queue& queue, const service::SolidTissue& tissue,
                 const reference::SolidReference& truth) {
  service::SurfacePatch patch;
  for (std::size_t k = 3; k < 6; ++k)
    for (std::size_t i = 6; i < 10; ++i)
      patch.unknowns.push_back(reference::unknown(tissue.grid, i, 0, k, 1));
  const auto size = Eigen::Index(patch.unknowns.size());
  patch.skin_m_n = VectorXd::Zero(size);
  VectorXd w(size);
  for (Eigen::Index n = 0; n < size; ++n) w[n] = 1e-3 * (1 - 0.05 * double(n % 5));
  const Eigen::MatrixXd compliance = truth.compliance(patch.unknowns);
  const VectorXd wanted = compliance.llt().solve(w);
  service::SolidSolver<T> solver(queue, tissue);
  const service::SolidSolution s = solver.push(patch, w, {.relative_error = 1e-7});
  const VectorXd off = s.force_n - wanted;
  say(part, {"solid of " + std::to_string(tissue.grid.elements()) + " nodes, force", kName<T>,
             std::sqrt(off.dot(compliance * off) / wanted.dot(w)), s.relative_error()});
}

// The energy norm of the error of the worst of some loads, against what the solver states.
void check_plane(DevicePart& part, const std::shared_ptr<service::Device>& device) {
  constexpr std::size_t kLoads = 4;
  const reference::TouchedTissue window = scene_window();
  const Eigen::SparseMatrix<double> k = reference::with_fixed(
      reference::assemble(window.grid, window.material), reference::fixed_dofs(window.grid, window.supports));
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(k);
  const std::vector<double> loads = surface_loads(window.grid, kLoads);
  for (const auto& [name, precision] : {std::pair{"float", service::SolvePrecision::kFloat},
                                        std::pair{"refined", service::SolvePrecision::kRefined},
                                        std::pair{"double", service::SolvePrecision::kDouble}}) {
    if (precision == service::SolvePrecision::kDouble && !device->info().has_double) continue;
    service::ElasticitySolverOptions options;
    options.precision = precision;
    service::ElasticitySolver solver(device, window.grid, window.supports, window.material, options);
    std::vector<double> u(loads.size());
    const service::SolveReport report = solver.solve(kLoads, loads, u);
    double worst = 0;
    for (std::size_t q = 0; q < kLoads; ++q) {
      const auto dofs = Eigen::Index(window.grid.dofs());
      const VectorXd wanted =
          factor.solve(Eigen::Map<const VectorXd>(loads.data() + q * window.grid.dofs(), dofs));
      const VectorXd off = Eigen::Map<const VectorXd>(u.data() + q * window.grid.dofs(), dofs) - wanted;
      worst = std::max(worst, std::sqrt(off.dot(k * off) / wanted.dot(k * wanted)));
    }
    say(part, {"plane solve, 123 x 34 nodes", name, worst, report.relative_error});
  }
}

void check_imaging(DevicePart& part, const service::Queue& queue) {
  const Phantom p = Phantoms().make({}, 1);
  service::DisplacementEstimator displacement(queue, {});
  service::StrainEstimator strain(queue, {});
  const service::DisplacementEstimate estimate = displacement.estimate(p.pre, p.post, p.geometry);
  service::Measured m;
  m.grid = service::image_grid(estimate.grid, p.geometry);
  service::download(queue, estimate, m);
  const service::StrainEstimate strains = strain.estimate(estimate, m.grid);
  // Of the truth, over the deviation that is stated. About a third of it is not the noise's.
  constexpr double kMostDeviations = 2;
  const auto doubles = [](const service::Field& field) {
    return std::vector<double>(field.begin(), field.end());
  };
  const Calibration z = standardised_errors({m.grid,
                                             doubles(m.axial_displacement),
                                             {},
                                             doubles(m.axial_displacement_std),
                                             {},
                                             m.displacement_valid},
                                            p);
  say(part, {"displacement, in stated deviations", "float", z.outside, kMostDeviations});

  reference::DisplacementField field{int(m.grid.nx), int(m.grid.ny), m.grid.dx_m, m.grid.dy_m, {}, {}, {}};
  field.lateral = doubles(m.lateral_displacement), field.axial = doubles(m.axial_displacement);
  const std::vector<std::uint8_t> trusted = queue.read(estimate.trusted);
  field.trusted.assign(trusted.begin(), trusted.end());
  const std::vector<float> tensor = queue.read(strains.tensor);
  const auto half = [](double kernel_m, double step_m) { return int(std::lround(kernel_m / step_m)) / 2; };
  constexpr int kEvery = 7;            // nodes
  constexpr double kOffStrain = 2e-5;  // as the test of the kernel allows
  double off = 0;
  for (std::size_t n = 0; n < m.grid.size(); n += kEvery) {
    const auto wanted = reference::least_squares_strain(
        field, int(n % m.grid.nx), int(n / m.grid.nx), half(strain.options().kernel_lateral_m, m.grid.dx_m),
        half(strain.options().kernel_axial_m, m.grid.dy_m), 0.6);
    if (wanted.determined != std::isfinite(tensor[4 * n + 1])) off = kNan;
    if (wanted.determined) off = std::max(off, std::abs(tensor[4 * n + 1] - wanted.axial));
  }
  say(part, {"strain, as it is", "float", off, kOffStrain});

  service::RfFrame lines{p.pre.sample_count, 8, {}};
  lines.samples.assign(p.pre.samples.begin(), p.pre.samples.begin() + std::ptrdiff_t(8 * lines.sample_count));
  const service::BMode image = service::BModeImager(queue).image(lines, p.geometry);
  const double period = p.geometry.sampling_frequency_hz / p.geometry.center_frequency_hz;
  const auto grey =
      reference::b_mode({lines.samples.begin(), lines.samples.end()}, int(lines.sample_count), 8, period,
                        std::max(1, int(period / 16)),
                        int((lines.sample_count + service::BMode::kMaxRows - 1) / service::BMode::kMaxRows));
  int most = grey.size() == image.grey.size() ? 0 : 255;
  for (std::size_t n = 0; n < std::min(grey.size(), image.grey.size()); ++n)
    if (grey[n] > 60) most = std::max(most, std::abs(int(grey[n]) - int(image.grey[n])));
  say(part, {"B-mode, of 255 greys", "float", most / 255.0, 1 / 255.0});
}

}  // namespace

void measure_references(DevicePart& part) {
  const auto device = part.open();
  const service::Queue queue = device->queue();
  const service::SolidTissue tissue =
      solid_tissue(part.quick ? solid_grid(16, 8, 6, 0.004, 0.004) : solid_grid(32, 16, 8, 0.004, 0.004),
                   0.49, SolidLump{});
  const reference::SolidReference solid(tissue);
  check_operator<float>(part, queue), check_fourier<float>(part, queue);
  check_solid<float>(part, queue, tissue, solid);
  if (device->info().has_double) {
    check_operator<double>(part, queue), check_fourier<double>(part, queue);
    check_solid<double>(part, queue, tissue, solid);
  }
  check_plane(part, device);
  if (!part.quick) check_imaging(part, queue);
}

}  // namespace teletact::bench
