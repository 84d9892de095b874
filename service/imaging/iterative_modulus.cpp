// The iterative modulus (T3.3): regularised least squares on the measured axial displacement.
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "service/imaging/displacement_data.h"
#include "service/imaging/modulus.h"
#include "service/imaging/modulus_seed.h"
#include "service/imaging/total_variation.h"

namespace teletact::service {
namespace {

using Eigen::VectorXd;
const KnownModulus kNothingKnown;
constexpr double kStepSolves = 4;     // a step takes about as long as so many forward solves
constexpr double kLargestStep = 1.0;  // of log E, in one Gauss-Newton step

// The unknown is theta = log(E / background) of every element of the strip.
class Problem {
 public:
  Problem(StripModel& model, DisplacementData data, VectorXd prior, double background,
          const IterativeOptions& options)
      : model_(model),
        data_(std::move(data)),
        prior_(std::move(prior)),
        background_(background),
        options_(options),
        variation_(model.grid(), options.tv_floor_per_m),
        prior_weight_(prior_.size()) {
    const TissueGrid& g = model.grid();
    const double per_m2 = 1 / (options.prior_deviation * options.prior_deviation * 1e-6);
    for (std::size_t e = 0; e < g.elements(); ++e) {
      const std::size_t i = e % (g.nx() - 1), j = e / (g.nx() - 1);
      const bool under = i >= model.first_column() && i < model.last_column();
      prior_weight_[static_cast<Eigen::Index>(e)] =
          (under ? 1 : options.prior_beside) * per_m2 * (g.x_m[i + 1] - g.x_m[i]) * (g.y_m[j + 1] - g.y_m[j]);
    }
  }

  struct Point {
    VectorXd theta;
    StripResponse response;
    DisplacementData::Fit fit;
    double objective = 0;
  };
  // One forward solve; its factor serves step() until the next.
  Point at(VectorXd theta) {
    Point p{std::move(theta), {}, {}, 0};
    p.response = model_.solve(modulus(p.theta));
    p.fit = data_.fit(p.response.displacement);
    const VectorXd off = p.theta - prior_;
    p.objective = p.fit.misfit + options_.tv_per_m * variation_.value(p.theta) +
                  0.5 * off.dot(prior_weight_.cwiseProduct(off));
    return p;
  }

  // (J^T J + alpha L + prior) step = - gradient, by conjugate gradients preconditioned with what the data do
  // not need a forward solve for.
  VectorXd step(const Point& p) {
    const std::vector<double> e = modulus(p.theta);
    const Eigen::SparseMatrix<double> lagged = options_.tv_per_m * variation_.lagged(p.theta);
    VectorXd r = -(lagged * p.theta) - prior_weight_.cwiseProduct(p.theta - prior_) -
                 adjoint(p, e, data_.weighted(p.fit));
    Eigen::SparseMatrix<double> near = lagged;
    near.diagonal() += prior_weight_ + typical_data_weight(p);
    preconditioner_.compute(near);
    VectorXd step = VectorXd::Zero(r.size()), z = preconditioner_.solve(r), d = z;
    double rz = r.dot(z);
    const double enough = options_.inner_tolerance * options_.inner_tolerance * rz;
    for (int k = 0; k < options_.most_products && rz > enough; ++k) {
      const VectorXd h = lagged * d + prior_weight_.cwiseProduct(d) + adjoint(p, e, forward(p, e, d));
      const double length = rz / d.dot(h);
      step += length * d;
      r -= length * h;
      z = preconditioner_.solve(r);
      const double next = r.dot(z);
      d = z + next / rz * d;
      rz = next;
    }
    const double largest = step.cwiseAbs().maxCoeff();
    return largest > kLargestStep ? VectorXd(kLargestStep / largest * step) : step;
  }

  std::vector<double> modulus(const VectorXd& theta) const {
    std::vector<double> e(static_cast<std::size_t>(theta.size()));
    for (std::size_t k = 0; k < e.size(); ++k)
      e[k] = background_ * std::exp(theta[static_cast<Eigen::Index>(k)]);
    return e;
  }

 private:
  // J d: dE = E d.
  std::vector<double> forward(const Point& p, const std::vector<double>& e, const VectorXd& d) {
    std::vector<double> change(e.size());
    for (std::size_t k = 0; k < e.size(); ++k) change[k] = e[k] * d[static_cast<Eigen::Index>(k)];
    return data_.change(p.fit, model_.change(p.response, change));
  }
  VectorXd adjoint(const Point& p, const std::vector<double>& e, const std::vector<double>& residual) {
    const std::vector<double> s = model_.sensitivity(p.response, data_.transposed(p.fit, residual));
    VectorXd out(static_cast<Eigen::Index>(e.size()));
    for (std::size_t k = 0; k < e.size(); ++k) out[static_cast<Eigen::Index>(k)] = e[k] * s[k];
    return out;
  }
  // Diagonal that stands for J^T J: an element's own shortening, seen by the data of a few elements.
  VectorXd typical_data_weight(const Point& p) const {
    const std::vector<double> w = data_.weight_of_elements(model_.grid(), p.fit, p.response.displacement);
    return kSeenBy * Eigen::Map<const VectorXd>(w.data(), p.theta.size());
  }

  static constexpr double kSeenBy = 3;
  StripModel& model_;
  DisplacementData data_;
  VectorXd prior_;
  double background_;
  const IterativeOptions& options_;
  TotalVariation variation_;
  VectorXd prior_weight_;
  Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> preconditioner_;
};

class Iterative : public ModulusMethod {
 public:
  Iterative(Queue queue, IterativeOptions options, DirectOptions direct, std::shared_ptr<StripCache> strips)
      : queue_(std::move(queue)),
        options_(options),
        shrink_{direct.background_below, direct.full_above},
        strips_(strips ? std::move(strips) : std::make_shared<StripCache>()),
        direct_(make_direct(queue_, direct, strips_)) {}

  ModulusEstimate estimate(const ModulusInput& in) override {
    ModulusEstimate out = direct_->estimate(in);
    out.kind = ModulusKind::kIterative;
    const auto strip = strips_->get(in.tissue, in.window_width_m);
    StripModel& model = strip->model;
    VectorXd start = logarithms(model, in, out);
    DisplacementData data(model, in.grid, queue_.read(in.displacement.field_m),
                          queue_.read(in.displacement.trusted), deviations(in), kTrackingWindowM2);
    VectorXd prior = VectorXd::Zero(start.size());
    if (in.known && out.absolute) prior = beside(model, start);
    Problem problem(model, std::move(data), std::move(prior), out.background, options_);
    const Problem::Point best = iterate(problem, in, model, start, out);
    publish(in, model, problem, best, out);
    return out;
  }

 private:
  VectorXd logarithms(const StripModel& model, const ModulusInput& in, const ModulusEstimate& map) const {
    std::vector<double> e = model.on_elements(map.youngs_modulus, in.grid, map.background,
                                              map.absolute ? in.known : kNothingKnown);
    shrink(e, map.background, shrink_);
    VectorXd out(static_cast<Eigen::Index>(e.size()));
    for (std::size_t k = 0; k < e.size(); ++k)
      out[static_cast<Eigen::Index>(k)] = std::log(e[k] / map.background);
    return out;
  }

  // What is known beside the window, 0 under it.
  static VectorXd beside(const StripModel& model, VectorXd theta) {
    const std::size_t columns = model.grid().nx() - 1;
    for (Eigen::Index e = 0; e < theta.size(); ++e) {
      const std::size_t i = static_cast<std::size_t>(e) % columns;
      if (i >= model.first_column() && i < model.last_column()) theta[e] = 0;
    }
    return theta;
  }

  // Standard deviation of the axial displacement: as it came with it, else the median of what the strain's
  // plane fits left over.
  std::vector<float> deviations(const ModulusInput& in) const {
    const auto least = static_cast<float>(options_.least_deviation_m);
    std::vector<float> out(in.grid.size(), least);
    if (in.displacement.std_m.size() > 0) {
      const std::vector<float> std_m = queue_.read(in.displacement.std_m);
      for (std::size_t n = 0; n < out.size(); ++n) out[n] = std::max(std_m[2 * n + 1], least);
      return out;
    }
    const std::vector<float> tensor = queue_.read(in.strain.tensor);
    const std::vector<std::uint8_t> trusted = queue_.read(in.strain.trusted);
    std::vector<float> left;
    for (std::size_t n = 0; n < trusted.size(); ++n)
      if (trusted[n]) left.push_back(tensor[4 * n + 3]);
    if (left.empty()) return out;
    const auto middle = left.begin() + static_cast<std::ptrdiff_t>(left.size() / 2);
    std::nth_element(left.begin(), middle, left.end());
    out.assign(out.size(), std::max(*middle, least));
    return out;
  }

  // Gauss-Newton with halved steps where the objective does not fall, as long as time is left for one more.
  Problem::Point iterate(Problem& problem, const ModulusInput& in, const StripModel& model,
                         const VectorXd& start, ModulusEstimate& out) const {
    const auto left = [&in] { return in.seconds_left ? in.seconds_left() : 1e9; };
    const double begun = left();
    Problem::Point best = problem.at(start);
    double longest_s = kStepSolves * (begun - left()), factor = 1;
    out.converged = false;
    VectorXd step;
    for (out.iterations = 0; out.iterations < options_.most_steps && !out.converged;) {
      const double before = left();
      if (before <= longest_s) break;
      if (factor == 1) step = problem.step(best);
      Problem::Point next = problem.at(best.theta + factor * step);
      ++out.iterations;
      if (next.objective < best.objective) {
        out.converged = factor * under_probe(model, step) < options_.converged_step;
        best = std::move(next);
        factor = 1;
      } else {
        factor *= 0.5;
      }
      longest_s = std::max(longest_s, before - left());
    }
    return best;
  }

  static double under_probe(const StripModel& model, const VectorXd& step) {
    const std::size_t columns = model.grid().nx() - 1;
    double sum = 0, count = 0;
    for (Eigen::Index e = 0; e < step.size(); ++e) {
      const std::size_t i = static_cast<std::size_t>(e) % columns;
      if (i >= model.first_column() && i < model.last_column()) sum += step[e] * step[e], ++count;
    }
    return std::sqrt(sum / count);
  }

  void publish(const ModulusInput& in, const StripModel& model, const Problem& problem,
               const Problem::Point& best, ModulusEstimate& out) const {
    if (!out.converged)
      out.warnings.push_back({ModulusFlag::kDeadline, "the iterative modulus was stopped after " +
                                                          std::to_string(out.iterations) +
                                                          " steps, before it had settled: this is the best "
                                                          "so far; give it more time, if it had too little"});
    if (out.iterations == 0) return;  // the direct one
    std::erase_if(out.warnings, [](const auto& w) { return w.flag == ModulusFlag::kCompressible; });
    if (best.fit.mean_square > options_.largest_misfit)
      out.warnings.push_back(
          {ModulusFlag::kMisfit, "no modulus explains the displacement: it is off by " +
                                     std::to_string(std::lround(std::sqrt(best.fit.mean_square))) +
                                     " standard deviations (rms); the extent, the plane condition or the "
                                     "probe's contact may not be "
                                     "as stated"});
    ForwardSolve forward;
    forward.response = best.response;
    forward.amplitude_m = best.fit.amplitude;
    const double scale = force_scale(in, forward);
    const Field map = model.on_image(problem.modulus(best.theta), in.grid);
    for (std::size_t n = 0; n < map.size(); ++n)
      if (std::isfinite(out.youngs_modulus[n])) out.youngs_modulus[n] = static_cast<float>(scale) * map[n];
    normalise(out);
  }

  Queue queue_;
  IterativeOptions options_;
  Shrink shrink_;
  std::shared_ptr<StripCache> strips_;
  std::unique_ptr<ModulusMethod> direct_;
};

}  // namespace

std::unique_ptr<ModulusMethod> make_iterative(Queue queue, IterativeOptions options, DirectOptions direct,
                                              std::shared_ptr<StripCache> strips) {
  return std::make_unique<Iterative>(std::move(queue), options, direct, std::move(strips));
}

}  // namespace teletact::service
