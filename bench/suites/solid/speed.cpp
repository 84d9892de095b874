// Time and memory of a touch of solid tissue, and of its force; beside sparse factors until they take too
// long, and conjugate gradients with Jacobi's preconditioner, an incomplete factor and algebraic multigrid.
#include <fmt/format.h>
#include <stdlib.h>

#include <Eigen/Cholesky>
#include <Eigen/IterativeLinearSolvers>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/device_figures.h"
#include "bench/peers/linear_solver.h"
#include "bench/suites/solid/solid.h"
#include "bench/suites/solid/truth.h"

namespace teletact::bench {
namespace {

using Sparse = Eigen::SparseMatrix<double>;

// The factor's fill grows with the nodes' 4/3, its time with their square.
constexpr std::size_t kMaxPeerNodes = 100'000, kMaxFactoredNodes = 15'000;
constexpr double kCertified = 1e-3, kPeerError = 1e-6, kQuietLoad = 0.5;

struct Own {
  std::size_t nodes = 0;
  std::string precision;
  double setup_s = 0, iteration_s = 0, certified_s = 0;  // to 1e-3, from the load on
  std::size_t certified_iterations = 0;
  double held_bytes = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Own, nodes, precision, setup_s, iteration_s, certified_s,
                                   certified_iterations, held_bytes)

// Under a tip 2 mm deep over a ball of contrast 10, which nodes touch being known; in float.
struct Force {
  std::size_t nodes = 0;
  double ball_depth_m = 0;
  double certified_s = 0, certified = 0;  // to 1e-3: its time, and what the interval comes to
  double certified_error = 0;             // the true one
  std::size_t certified_iterations = 0;
  double true_s = 0, true_error = 0;  // as soon as it is within 1e-3, and stays so
  std::size_t true_iterations = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Force, nodes, ball_depth_m, certified_s, certified, certified_error,
                                   certified_iterations, true_s, true_error, true_iterations)

struct Point {
  std::size_t nodes = 0;
  std::string method;
  bool ours = false;
  double setup_s = 0, solve_s = 0, error = 0;  // true, of the energy norm
  std::size_t iterations = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Point, nodes, method, ours, setup_s, solve_s, error, iterations)

struct Figures {
  DeviceFigures device;
  double load_average = 0;  // when it began: other programs' if above 0
  std::vector<Own> own{};
  std::vector<Force> forces{};
  std::vector<Point> points{};
  std::vector<std::string> absent{};  // peers that are not installed
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, device, load_average, own, forces, points, absent)

template <class T>
void measure_own(const std::shared_ptr<service::Device>& device, const service::SolidTissue& tissue,
                 const SolidTouch& touch, const SolidTruth* truth, int repeats, Figures& f) {
  constexpr std::size_t kSteps = 20;
  const std::size_t nodes = tissue.grid.elements();
  const service::Queue queue = device->queue();
  Own own{nodes, std::is_same_v<T, float> ? "float" : "double"};
  { service::SolidSolver<T> compiles(queue, tissue); }
  const double before = double(device->held_bytes());
  std::unique_ptr<service::SolidSolver<T>> solver;
  std::vector<double> setups, iterations, certified;
  for (int k = 0; k < repeats; ++k) {
    solver.reset();
    setups.push_back(seconds_of([&] {
      solver = std::make_unique<service::SolidSolver<T>>(queue, tissue);
      queue.finish();
    }));
  }
  const auto seconds_to = [&](double error, std::size_t most, service::SolidSolution* answer = nullptr) {
    return seconds_of([&] {
      const auto s = touch.solve(*solver, {.relative_error = error, .max_iterations = most});
      if (answer != nullptr) *answer = s;
    });
  };
  seconds_to(0, 1);  // compiles
  own.held_bytes = double(device->held_bytes()) - before;
  for (int k = 0; k < repeats; ++k) {
    iterations.push_back((seconds_to(0, kSteps) - seconds_to(0, 0)) / kSteps);
    service::SolidSolution s;
    certified.push_back(seconds_to(kCertified, 1000, &s));
    own.certified_iterations = s.iterations;
    if (s.reason != service::StopReason::kConverged || !s.certified)
      throw BenchError(fmt::format("{} nodes in {}: not certified to 1e-3", nodes, own.precision));
  }
  own.setup_s = median_of(setups), own.iteration_s = median_of(iterations),
  own.certified_s = median_of(certified);
  std::printf(
      "%7zu nodes, %-6s set-up %8.2f ms  iteration %7.3f ms  certified to 1e-3 in %2zu, %8.2f ms  "
      "arrays %6.1f MB\n",
      nodes, own.precision.c_str(), 1e3 * own.setup_s, 1e3 * own.iteration_s, own.certified_iterations,
      1e3 * own.certified_s, 1e-6 * own.held_bytes);
  f.own.push_back(own);
  if (truth == nullptr) return;
  for (const std::size_t k : {0, 1, 2, 4, 6, 8, 10, 12, 15, 20, 25}) {
    service::SolidSolution s;
    std::vector<double> seconds;
    for (int n = 0; n < repeats; ++n) seconds.push_back(seconds_to(0, k, &s));
    f.points.push_back({nodes, "layered PCG, " + own.precision, true, own.setup_s, median_of(seconds),
                        std::sqrt(truth->squared_error(field_of(*solver))), k});
  }
}

struct CertifiedForce {
  double force_n = 0, error_n = 0;  // at most
  std::size_t iterations = 0;
};
// From two energies: pushed by s more and by s less they differ by 2 s F, and each is known from both sides.
// With s = |u| / |z|, z the unit push, it is off by about |e_u| |e_z| at most.
CertifiedForce certified_force(service::SolidSolver<float>& solver, const SolidTouch& touch,
                               double relative_error) {
  const Eigen::VectorXd &w = touch.surface.values, one = Eigen::VectorXd::Ones(w.size());
  const Eigen::LLT<Eigen::MatrixXd> layered(solver.row()->layered.among(touch.surface.unknowns));
  const Eigen::VectorXd p = layered.solve(w), z = layered.solve(one);
  const double s = std::sqrt(w.dot(p) / z.sum());
  // Of the layered tissue: the whole is stiffer, or asks for a little more.
  const double each_j = 0.8 * relative_error * 2 * s * p.sum();
  CertifiedForce out;
  for (const double side : {1.0, -1.0}) {
    const double energy_j = (w.dot(p) + 2 * side * s * p.sum() + s * s * z.sum()) / 2;
    const auto answer =
        solver.push({touch.surface.unknowns, Eigen::VectorXd::Zero(w.size())}, w + side * s * one,
                    {.relative_error = std::min(0.5, std::sqrt(each_j / energy_j))});
    out.force_n += side * (answer.energy_j - answer.energy_error_j / 2) / (2 * s);
    out.error_n += answer.energy_error_j / (4 * s);
    out.iterations += answer.iterations;
  }
  return out;
}

void measure_force(const service::Queue& queue, const service::SolidGrid& grid, double ball_depth_m,
                   int repeats, Figures& f) {
  const service::SolidTissue tissue = solid_tissue(grid, 0.49, {.centre_m = {0, ball_depth_m, 0}});
  SolidTouch touch;
  double exact_n = 0;
  {
    service::SolidSolver<double> solver(queue, tissue);
    touch = settled_touch(solver, grid, 0, 0, 0.002, 0);
    exact_n = touch.solve(solver, {.relative_error = 1e-9, .max_iterations = 1000}).force_n.sum();
  }
  service::SolidSolver<float> solver(queue, tissue);
  Force out{grid.elements(), ball_depth_m};
  const auto median_seconds = [&](auto&& work) {
    std::vector<double> seconds;
    for (int k = 0; k < repeats; ++k) seconds.push_back(seconds_of(work));
    return median_of(seconds);
  };
  CertifiedForce c;
  out.certified_s = median_seconds([&] { c = certified_force(solver, touch, kCertified); });
  out.certified = c.error_n / c.force_n, out.certified_iterations = c.iterations;
  out.certified_error = std::abs(c.force_n / exact_n - 1);
  const auto error_after = [&](std::size_t k) {
    return std::abs(touch.solve(solver, {.relative_error = 0, .max_iterations = k}).force_n.sum() / exact_n -
                    1);
  };
  constexpr std::size_t kMax = 20;
  for (std::size_t k = 0; k <= kMax; ++k)
    if (error_after(k) > kCertified) out.true_iterations = k + 1;
  out.true_error = error_after(out.true_iterations);
  out.true_s = median_seconds([&] { error_after(out.true_iterations); });
  std::printf(
      "%7zu nodes, ball %2.0f mm deep: force certified to %.1e (true %.1e) in %2zu, %8.2f ms; true to %.1e "
      "in "
      "%2zu, %8.2f ms\n",
      out.nodes, 1e3 * ball_depth_m, out.certified, out.certified_error, out.certified_iterations,
      1e3 * out.certified_s, out.true_error, out.true_iterations, 1e3 * out.true_s);
  f.forces.push_back(out);
}

void add(Point p, Figures& f) {
  std::printf("%7zu nodes, %-24s set-up %10.1f ms  solve %10.1f ms  %5zu iterations  error %.1e\n", p.nodes,
              p.method.c_str(), 1e3 * p.setup_s, 1e3 * p.solve_s, p.iterations, p.error);
  std::fflush(stdout);
  f.points.push_back(std::move(p));
}

template <class Preconditioner>
void measure_cg(const char* name, const Sparse& k, const Eigen::VectorXd& load, const SolidTruth& truth,
                std::size_t nodes, double to_error, Figures& f) {
  Eigen::ConjugateGradient<Sparse, Eigen::Lower | Eigen::Upper, Preconditioner> cg;
  const double setup_s = seconds_of([&] { cg.compute(k); });
  if (cg.info() != Eigen::Success) throw BenchError(std::string(name) + ": no preconditioner");
  cg.setTolerance(0);
  for (int most = 16; most <= 1 << 14; most *= 2) {
    cg.setMaxIterations(most);
    Eigen::VectorXd u;
    const double solve_s = seconds_of([&] { u = cg.solve(load); });
    const double error = std::sqrt(truth.squared_error(u));
    add({nodes, name, false, setup_s, solve_s, error, std::size_t(most)}, f);
    if (error <= to_error) return;
  }
}

void measure_peers(const Sparse& k, const Eigen::VectorXd& load, const SolidTruth& truth, std::size_t nodes,
                   bool quick, Figures& f) {
  std::vector<std::string> absent(2);
  for (const auto& peer : {make_cholmod_factor(absent[0]), make_viennacl_multigrid(absent[1])}) {
    if (!peer) continue;
    const double setup_s = seconds_of([&] { peer->prepare(k); });
    for (int most = peer->iterative() ? 8 : 0; most <= 1 << 12; most = std::max(1, 2 * most)) {
      Eigen::VectorXd u;
      const double solve_s = seconds_of([&] { u = peer->solve(load, most); });
      const double error = std::sqrt(truth.squared_error(u));
      add({nodes, peer->name(), false, setup_s, solve_s, error, std::size_t(most)}, f);
      if (!peer->iterative() || error <= kCertified) break;
    }
  }
  std::erase(absent, "");
  f.absent = absent;
  for (const std::string& why : absent) std::printf("not compared with: %s\n", why.c_str());
  const double to_error = quick || nodes > kMaxFactoredNodes ? kCertified : kPeerError;
  measure_cg<Eigen::DiagonalPreconditioner<double>>("CG, Jacobi", k, load, truth, nodes, to_error, f);
  measure_cg<Eigen::IncompleteCholesky<double>>("CG, incomplete Cholesky", k, load, truth, nodes, to_error,
                                                f);
  if (nodes > (quick ? kMaxFactoredNodes / 3 : kMaxFactoredNodes)) return;
  Eigen::SimplicialLDLT<Sparse> factor;
  const double setup_s = seconds_of([&] { factor.compute(k); });
  if (factor.info() != Eigen::Success) throw BenchError("Eigen's factor failed");
  Eigen::VectorXd u;
  const double solve_s = seconds_of([&] { u = factor.solve(load); });
  add({nodes, "Eigen SimplicialLDLT", false, setup_s, solve_s, std::sqrt(truth.squared_error(u)), 0}, f);
}

void promise(const Figures& f, Promises& promises) {
  struct Size {
    std::size_t nodes;
    const char* name;
    double bytes, iteration_s, certified_s, true_s;
  };
  const bool quiet = f.load_average < kQuietLoad;
  if (!quiet)
    std::printf("other programs are running (load %.1f): times are reported, not promised\n", f.load_average);
  for (const Size& size : {Size{solid_70k().elements(), "70k", 16e6, 1.6e-3, 0.030, 0.012},
                           {solid_336k().elements(), "336k", 64e6, 7e-3, 0.150, 0.055}})
    for (const Own& own : f.own) {
      if (own.nodes != size.nodes || own.precision != "float") continue;
      promises.push_back({fmt::format("arrays_held_{}", size.name), own.held_bytes, size.bytes, "bytes"});
      if (quiet)
        promises.push_back({fmt::format("iteration_{}", size.name), own.iteration_s, size.iteration_s, "s"});
      if (!quiet) continue;
      double certified_s = 0, true_s = 0;
      for (const Force& force : f.forces)
        if (force.nodes == size.nodes)
          certified_s = std::max(certified_s, force.certified_s), true_s = std::max(true_s, force.true_s);
      promises.push_back({fmt::format("force_certified_{}", size.name), certified_s, size.certified_s, "s"});
      promises.push_back({fmt::format("force_true_{}", size.name), true_s, size.true_s, "s"});
    }
  for (const Force& force : f.forces)
    promises.push_back(
        {fmt::format("force_certified_to_{}_nodes_ball_{}_mm_deep", force.nodes, 1e3 * force.ball_depth_m),
         std::max(force.certified, force.certified_error), kCertified});
  for (const Point& p : f.points)
    for (const Own& own : f.own)
      if (p.nodes == own.nodes && own.precision == "float") {
        const double ratio = (p.setup_s + p.solve_s) / (own.setup_s + own.certified_s);
        const std::string name = snake_case(p.method);
        const bool multigrid = name.find("multigrid") != std::string::npos;
        if (multigrid ? p.error <= kCertified : !p.ours && p.iterations == 0)
          promises.push_back({fmt::format("{}_over_certified_touch_{}_nodes", name, p.nodes), ratio,
                              multigrid ? 50.0 : 200.0, "1", false});
      }
}

Figures measure(bool quick, Promises& promises) {
  const auto device = service::Device::open();
  Figures f{describe(device->info())};
  getloadavg(&f.load_average, 1);
  std::vector<service::SolidGrid> sizes{quick ? solid_grid(32, 16, 8, 0.004, 0.004) : solid_13k(),
                                        solid_70k()};
  if (!quick) sizes.push_back(solid_336k());
  for (const service::SolidGrid& grid : sizes) {
    const service::SolidTissue tissue = solid_tissue(grid, 0.49, {});
    const SolidTouch touch{hertz_load(grid)};
    const bool peers = grid.elements() <= (quick ? kMaxFactoredNodes : kMaxPeerNodes);
    Sparse k;
    std::optional<SolidTruth> truth;
    if (peers) {
      k = reference::assemble(tissue);
      service::SolidSolver<double> solver(device->queue(), tissue);
      truth.emplace(k, solver, touch);
    }
    const int repeats = quick ? 3 : 9;
    measure_own<float>(device, tissue, touch, truth ? &*truth : nullptr, repeats, f);
    measure_own<double>(device, tissue, touch, truth ? &*truth : nullptr, repeats, f);
    for (const double depth : {0.007, 0.012}) measure_force(device->queue(), grid, depth, repeats, f);
    if (!peers) continue;
    Eigen::VectorXd load = Eigen::VectorXd::Zero(k.rows());
    for (std::size_t n = 0; n < touch.surface.unknowns.size(); ++n)
      load[Eigen::Index(touch.surface.unknowns[n])] = touch.surface.values[Eigen::Index(n)];
    measure_peers(k, load, *truth, grid.elements(), quick, f);
  }
  promise(f, promises);
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  std::vector<std::size_t> sizes;
  std::vector<Curve> time;
  for (const Own& own : f.own) {
    const std::string title = "certified to 1e-3, " + own.precision;
    auto curve = std::find_if(time.begin(), time.end(), [&](const Curve& c) { return c.title == title; });
    if (curve == time.end()) curve = time.insert(time.end(), {.title = title, .ours = true});
    curve->add(double(own.nodes), 1e3 * (own.setup_s + own.certified_s));
  }
  std::vector<std::string> methods;
  for (const Point& p : f.points) {
    if (std::find(sizes.begin(), sizes.end(), p.nodes) == sizes.end()) sizes.push_back(p.nodes);
    if (std::find(methods.begin(), methods.end(), p.method) == methods.end()) methods.push_back(p.method);
  }
  for (const std::size_t nodes : sizes) {
    std::vector<Curve> curves;
    for (std::size_t m = 0; m < methods.size(); ++m) {
      Curve curve{.title = methods[m], .look = m};
      for (const Point& p : f.points) {
        if (p.nodes != nodes || p.method != methods[m]) continue;
        curve.ours = p.ours;
        curve.add(std::max(1e-12, p.error), 1e3 * (p.setup_s + p.solve_s));
      }
      if (!curve.x.empty()) curves.push_back(std::move(curve));
    }
    plot(folder / fmt::format("solid_accuracy_{}.png", nodes),
         script_of(curves,
                   "set logscale xy\nset format x '10^{%L}'\nset key outside bottom center horizontal\n" +
                       axes(fmt::format("{} nodes, nu 0.49, a sphere of contrast 10", nodes),
                            "true error of the energy norm", "set-up and one touch (ms)")));
  }
  plot(folder / "solid_time.png",
       script_of(time, "set logscale xy\nset key top left\n" +
                           axes("A sphere of contrast 10", "nodes", "set-up and one touch (ms)")));
}

}  // namespace

Part solid_speed() {
  return make_part("speed", measure, draw);
}

}  // namespace teletact::bench
