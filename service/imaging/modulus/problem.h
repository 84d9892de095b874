// The objective of the iterative modulus (T3.3), and its Gauss-Newton step. The unknown is theta = log(E /
// background) of every element of the strip:
//   1/2 |(S u(E) a + b - d) / sigma|^2 + alpha TV(theta) + 1/2 |prior weight^(1/2) (theta - prior)|^2
// amplitude a and offset b fitted at every theta.
#pragma once

#include <deque>
#include <vector>

#include "service/imaging/modulus/displacement_data.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/sparse_factor.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/modulus/total_variation.h"

namespace teletact::service {

// How well log E is known where the objective is least (Laplace, T3.5).
struct ModulusPosterior {
  Eigen::VectorXd deviation;  // standard deviation of log E as it is published, per element of the strip
  double correlation_m = 0;   // of exp(-distance / it), with which means over patches vary as they do
  double texture = 1;         // variance of the tissue over the prior's, as far as it was seen
};

// Standard deviation of log E about the background (or what is known), per square millimetre; and how much
// stronger the prior is beside the window, of which the data tell little.
inline constexpr double kPriorDeviation = 2, kPriorBeside = 40;

// The prior's precision, per element.
Eigen::VectorXd prior_weight(const StripModel&);

class ModulusProblem {
 public:
  // prior: of theta, [element]. The model must outlive the problem.
  ModulusProblem(StripModel&, DisplacementData, Eigen::VectorXd prior, double background);
  struct Point {
    Eigen::VectorXd theta;
    StripResponse response;
    DisplacementData::Fit fit;
    double objective = 0;
  };
  // One forward solve; its factor serves gradient() and step() until the next.
  Point at(Eigen::VectorXd theta);
  // Derivative of the objective by theta, at the latest at().
  Eigen::VectorXd gradient(const Point&);
  // (J^T J + alpha L + prior) step = - gradient, by conjugate gradients preconditioned with what the data do
  // not need a forward solve for, corrected by what the products of the steps before have shown: the matrix
  // changes little from one step to the next (Morales and Nocedal 2000).
  Eigen::VectorXd step(const Point&);
  std::vector<double> modulus(const Eigen::VectorXd& theta) const;
  // About the latest at(), the last thing that is asked (posterior.cpp).
  ModulusPosterior posterior(const Point&, bool absolute);

 private:
  // y = H s.
  struct Product {
    Eigen::VectorXd s, y;
    double sy;
  };
  Eigen::VectorXd preconditioned(Eigen::VectorXd residual, std::size_t products) const;
  std::vector<double> forward(const Point&, const std::vector<double>& e, const Eigen::VectorXd& d);
  Eigen::VectorXd adjoint(const Point&, const std::vector<double>& e, const std::vector<double>& residual);

  StripModel& model_;
  DisplacementData data_;
  Eigen::VectorXd prior_;
  double background_;
  TotalVariation variation_;
  Eigen::VectorXd prior_weight_;
  SparseFactor preconditioner_;
  std::deque<Product> products_;  // the latest, oldest first
};

}  // namespace teletact::service
