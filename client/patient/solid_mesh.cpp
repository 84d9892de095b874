#include "client/patient/solid_mesh.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "client/patient/parallel.h"
#include "client/patient/true_modulus.h"

namespace teletact::client {

namespace {

constexpr double kAlongYAndZ = 0.7, kGrowth = 0.4, kCoarsest = 6, kCoarsestBelow = 2, kAtEdge = 0.1;
constexpr double kFineDepth = 0.025, kBeyondLump = 0.002, kFineBesideM = 0.003;
constexpr double kMaxNodes = 2e6;

// How far apart lines are, anywhere along an axis.
struct Spacing {
  double fine_m, coarsest_m;    // between begin and end; the most
  double begin_m, end_m;        // beyond them it grows
  std::vector<double> edges_m;  // borders of the face: lines lie on them, close together
  double at(double x_m) const {
    const double beyond_m = std::max({0.0, begin_m - x_m, x_m - end_m});
    double spacing_m = std::min(fine_m + kGrowth * beyond_m, coarsest_m);
    for (const double edge : edges_m)
      spacing_m = std::min(spacing_m, kAtEdge * fine_m + kGrowth * std::abs(x_m - edge));
    return spacing_m;
  }
};

// Lines from begin to end through all edges: between two of those they lie at equal steps of the integral of
// 1 / spacing.
std::vector<double> lines(double begin, double end, const Spacing& spacing) {
  constexpr int kSteps = 2000;
  std::vector<double> stops;
  for (const double edge : spacing.edges_m)
    if (edge > begin + 1e-6 && edge < end - 1e-6) stops.push_back(edge);
  stops.push_back(end);
  std::vector<double> at_m{begin};
  for (const double stop : stops) {
    const double from = at_m.back(), step = (stop - from) / kSteps;
    std::vector<double> count(kSteps + 1, 0.0);
    for (int n = 0; n < kSteps; ++n) count[n + 1] = count[n] + step / spacing.at(from + step * (n + .5));
    const double cells = std::max(1.0, std::round(count.back()));
    for (int n = 0, cell = 1; cell < cells; ++cell) {
      const double wanted = count.back() * cell / cells;
      while (count[n + 1] < wanted) ++n;
      at_m.push_back(from + step * (n + (wanted - count[n]) / (count[n + 1] - count[n])));
    }
    at_m.push_back(stop);
  }
  return at_m;
}

bool symmetric(const Tissue& t, double window_z_m) {
  return window_z_m == 0 && t.solid->texture == 0 &&
         std::all_of(t.inclusions.begin(), t.inclusions.end(), [](const Inclusion& i) { return i.z_m == 0; });
}

double mean_modulus(const Tissue& tissue, const TrueModulus& modulus, const SolidMesh& mesh, std::size_t i,
                    std::size_t j, std::size_t k) {
  constexpr int kPoints = 4;
  double sum = 0;
  const auto at = [](const std::vector<double>& lines_m, std::size_t n, double part) {
    return lines_m[n] + (lines_m[n + 1] - lines_m[n]) * part;
  };
  for (int c = 0; c < kPoints; ++c)
    for (int b = 0; b < kPoints; ++b)
      for (int a = 0; a < kPoints; ++a)
        sum += tissue.true_modulus(at(mesh.x_m, i, (a + .5) / kPoints), at(mesh.y_m, j, (b + .5) / kPoints),
                                   at(mesh.z_m, k, (c + .5) / kPoints));
  return sum / (kPoints * kPoints * kPoints) *
         modulus.texture(at(mesh.x_m, i, .5), at(mesh.y_m, j, .5), at(mesh.z_m, k, .5));
}

}  // namespace

SolidMesh make_solid_mesh(const Tissue& t, double window_x_m, double spacing_m, double window_z_m) {
  if (!(spacing_m >= 1e-4)) throw TissueError("spacing_m: must be at least 1e-4");
  const Solid& solid = *t.solid;
  SolidMesh mesh;
  mesh.poisson_ratio = t.poisson_ratio;
  mesh.half = symmetric(t, window_z_m);
  const double narrow_m = kAlongYAndZ * spacing_m, end_m = solid.elevational_width_m / 2;
  const double face_m = std::min(end_m, t.probe.elevation_m / 2);
  double deep_m = kFineDepth, fine_m = face_m + kFineBesideM;
  for (const Inclusion& i : t.inclusions) {
    deep_m = std::max(deep_m, i.y_m + i.diameter_m / 2 + kBeyondLump);
    const double away_m = std::abs(i.z_m - window_z_m), radius_m = i.diameter_m / 2;
    if (i.sphere && away_m - radius_m < face_m + kFineBesideM)
      fine_m = std::max(fine_m, away_m + radius_m + kBeyondLump);
  }
  deep_m = std::min(deep_m, t.depth_m);
  const auto across = [&](double length_m) {
    return lines(0, length_m, {narrow_m, kCoarsest * narrow_m, 0, std::min(fine_m, length_m), {face_m}});
  };
  const double right_m = window_x_m + t.probe.width_m;
  mesh.x_m = lines(0, t.width_m,
                   {spacing_m,
                    kCoarsest * spacing_m,
                    window_x_m - kFineBesideM,
                    right_m + kFineBesideM,
                    {window_x_m, right_m}});
  mesh.y_m = lines(0, t.depth_m, {narrow_m, kCoarsestBelow * narrow_m, 0, deep_m, {0}});
  mesh.z_m = across(end_m - window_z_m);
  for (double& z : mesh.z_m) z += window_z_m;
  if (!mesh.half)
    for (const double beyond_m : across(end_m + window_z_m))
      if (beyond_m > 0) mesh.z_m.insert(mesh.z_m.begin(), window_z_m - beyond_m);
  const std::size_t rows = mesh.y_m.size() - 1;  // of tissue
  if (solid.support == Support::kBed)
    for (const double below : lines(t.depth_m, t.depth_m + solid.bed_depth_m,
                                    {kCoarsestBelow * narrow_m, kCoarsestBelow * narrow_m, 0, 1, {}}))
      if (below > t.depth_m) mesh.y_m.push_back(below);
  if (static_cast<double>(mesh.nodes()) > kMaxNodes)
    throw TissueError(
        "tissue.width_m, tissue.depth_m, solid.elevational_width_m: the mesh needs more than two "
        "million nodes; reduce them");
  const TrueModulus modulus(t);
  mesh.youngs_modulus_pa.resize((mesh.nx() - 1) * (mesh.ny() - 1) * (mesh.nz() - 1));
  in_parallel(mesh.nz() - 1, [&](std::size_t k) {
    for (std::size_t i = 0; i + 1 < mesh.nx(); ++i)
      for (std::size_t j = 0; j + 1 < mesh.ny(); ++j)
        mesh.youngs_modulus_pa[mesh.element(i, j, k)] =
            j < rows ? mean_modulus(t, modulus, mesh, i, j, k) : solid.bed_modulus_pa;
  });
  return mesh;
}

std::array<double, 576> box_stiffness(const std::array<double, 3>& sides_m, double poisson_ratio) {
  const double mu = 1 / (2 * (1 + poisson_ratio));
  const double lambda = poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  const double volume = sides_m[0] * sides_m[1] * sides_m[2];
  std::array<double, 576> stiffness{};
  // Gradients of the eight shape functions at a point of the unit cube.
  const auto gradients = [&](const std::array<double, 3>& at) {
    std::array<std::array<double, 3>, 8> g{};
    for (std::size_t n = 0; n < 8; ++n) {
      const std::array<std::size_t, 3> corner{n % 2, n / 2 % 2, n / 4};
      for (std::size_t d = 0; d < 3; ++d) {
        g[n][d] = (corner[d] == 1 ? 1 : -1) / sides_m[d];
        for (std::size_t other = 0; other < 3; ++other)
          if (other != d) g[n][d] *= corner[other] == 1 ? at[other] : 1 - at[other];
      }
    }
    return g;
  };
  const auto add = [&](const std::array<double, 3>& at, double of_mu, double of_lambda) {
    const auto g = gradients(at);
    for (std::size_t a = 0; a < 8; ++a)
      for (std::size_t b = 0; b < 8; ++b) {
        const double dot = g[a][0] * g[b][0] + g[a][1] * g[b][1] + g[a][2] * g[b][2];
        for (std::size_t c = 0; c < 3; ++c)
          for (std::size_t d = 0; d < 3; ++d)
            stiffness[24 * (3 * a + c) + 3 * b + d] +=
                of_mu * ((c == d ? dot : 0) + g[a][d] * g[b][c]) + of_lambda * g[a][c] * g[b][d];
      }
  };
  const double offset = .5 / std::sqrt(3.0);
  for (std::size_t n = 0; n < 8; ++n)
    add({.5 + (n % 2 == 1 ? offset : -offset), .5 + (n / 2 % 2 == 1 ? offset : -offset),
         .5 + (n / 4 == 1 ? offset : -offset)},
        volume / 8 * mu, 0);
  add({.5, .5, .5}, 0, volume * lambda);
  return stiffness;
}

SolidField::SolidField(const SolidMesh& mesh, std::vector<double> u) : mesh_(mesh), u_(std::move(u)) {
  if (u_.size() != 3 * mesh_.nodes()) throw std::invalid_argument("SolidField: u does not fit the mesh");
}

DisplacementField::Vector SolidField::at(double x_m, double y_m, double z_m) const {
  struct Place {
    std::size_t cell;
    double part;
  };
  const auto place = [](const std::vector<double>& lines_m, double at_m) {
    const double inside_m = std::clamp(at_m, lines_m.front(), lines_m.back());
    const auto above = std::upper_bound(lines_m.begin(), lines_m.end(), inside_m);
    const std::size_t cell =
        std::min(lines_m.size() - 2, static_cast<std::size_t>(above - lines_m.begin()) - 1);
    return Place{cell, (inside_m - lines_m[cell]) / (lines_m[cell + 1] - lines_m[cell])};
  };
  const bool mirrored = mesh_.half && z_m < 0;
  const Place x = place(mesh_.x_m, x_m), y = place(mesh_.y_m, y_m),
              z = place(mesh_.z_m, mirrored ? -z_m : z_m);
  std::array<double, 3> sum{};
  for (std::size_t n = 0; n < 8; ++n) {
    const std::size_t a = n % 2, b = n / 2 % 2, c = n / 4;
    const double weight = (a ? x.part : 1 - x.part) * (b ? y.part : 1 - y.part) * (c ? z.part : 1 - z.part);
    const double* u = &u_[3 * mesh_.node(x.cell + a, y.cell + b, z.cell + c)];
    for (std::size_t d = 0; d < 3; ++d) sum[d] += weight * u[d];
  }
  return {sum[0], sum[1], mirrored ? -sum[2] : sum[2]};
}

}  // namespace teletact::client
