// The objective of the iterative modulus (T3.3), and its Gauss-Newton step. The unknown is theta = log(E /
// background) of every element of the strip:
//   1/2 |(S u(E) a + b - d) / sigma|^2 + alpha TV(theta) + 1/2 |prior weight^(1/2) (theta - prior)|^2
// amplitude a and offset b fitted at every theta.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <vector>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/sparse_factor.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/modulus/total_variation.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

// The measured axial displacement as data for a forward model (T3.3): d ~ amplitude * S u + offset, where u
// is the model's answer to a push of 1 m, S its bilinear value at the trusted image nodes, and amplitude and
// offset (how far the probe was pushed; the frame's rigid motion) are fitted every time. The lateral
// component, an order noisier, is not used.
class DisplacementData {
 public:
  // min_deviation_m: no datum is taken for better; independent_m2: area over which the errors agree, so
  // that nodes closer than that do not count as often as there are.
  DisplacementData(const StripModel&, const Measured&, float min_deviation_m, double independent_m2);

  struct Fit {
    double amplitude = 0, offset_m = 0;
    std::vector<double> modelled;  // S u of every datum
    std::vector<double> residual;  // of every datum over its deviation
    double misfit = 0;             // half the sum of residual^2, each counted by its independence
    double mean_square = 0;        // of residual: 1 where the model is right and the deviations are
  };
  Fit fit(const std::vector<double>& displacement) const;  // of the strip, [dof]
  // The residual's change with the model's, amplitude and offset refitted (variable projection), weighted as
  // `residual` and by the square root of its independence; and the transposed.
  std::vector<double> change(const Fit&, const std::vector<double>& displacement_change) const;
  std::vector<double> transposed(const Fit&, const std::vector<double>& residual) const;
  // `residual` weighted as change() is.
  std::vector<double> weighted(const Fit&) const;
  // For many axial displacement changes of the strip, [node][column]: the scalar products of their change()
  // with each other, and the change of log(amplitude) that each brings about.
  struct Products {
    Eigen::MatrixXd of_changes;
    Eigen::VectorXd log_amplitude;
  };
  Products products(const Fit&, const StripModel::NodeColumns& axial_changes) const;
  // About the data's weight against a unit change of log E of each element: (its shortening /
  // deviation)^2 x the data of an element.
  std::vector<double> weight_of_elements(const TissueGrid&, const Fit&,
                                         const std::vector<double>& displacement) const;

 private:
  struct Datum {
    std::size_t node[4];  // of the strip
    float share[4];
    double displacement_m, weight;  // 1 / deviation
  };
  std::vector<double> observed(const std::vector<double>& displacement) const;
  void project(const Fit&, std::vector<double>& weighted) const;
  std::vector<Datum> data_;
  std::size_t dofs_ = 0;
  double independence_ = 1;  // of a datum: at most 1
};

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
