// The measured axial displacement as data for a forward model (T3.3): d ~ amplitude * S u + offset, where u
// is the model's answer to a push of 1 m, S its bilinear value at the trusted image nodes, and amplitude and
// offset (how far the probe was pushed; the frame's rigid motion) are fitted every time. The lateral
// component, an order noisier, is not used.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/tracking/measured.h"

namespace teletact::service {

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

}  // namespace teletact::service
