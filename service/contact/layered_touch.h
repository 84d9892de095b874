// A round tip pressed without friction on tissue whose stiffness changes with depth alone (T9.1): exact, with
// no mesh and no device. A table is made once; a touch takes a fraction of a microsecond.
#pragma once

#include <vector>

#include "service/contact/touch_model.h"
#include "service/tissue/solid/layered_kernel.h"

namespace teletact::service {

// Immutable: by any number of threads.
class LayeredTouch {
 public:
  struct At {
    double force_n = 0, stiffness_n_m = 0, energy_j = 0;  // F, dF/dd, the integral of F
    double radius_m = 0;                                  // of the contact
    // Of tissue so much stiffer.
    At times(double stiffer) const {
      return {force_n * stiffer, stiffness_n_m * stiffer, energy_j * stiffer, radius_m};
    }
  };
  // Throws std::invalid_argument unless the tip is round and frictionless.
  LayeredTouch(const LayerStack&, const Fingertip&);
  // Indentation that it knows; 0 where no contact could be solved.
  double max_m() const { return rows_.empty() ? 0 : rows_.back().indentation_m; }
  // Nothing where the indentation is not above 0; std::out_of_range beyond max_m().
  At at(double indentation_m) const;

 private:
  struct Row {
    double indentation_m, log_indentation, log_force, power, log_radius, radius_power, energy_j;
    double force_n() const;
  };
  struct Between;
  std::vector<Row> rows_;  // by growing indentation
};

// Makes the layered part of an answer on nodes exact (T9.3): energies multiply, U = U(nodes) U0 / U0(nodes),
// and forces, tangents, pressures and strains follow. `layered`: of the layered tissue on the same nodes,
// `exact`: its exact touch, both at the same pose; of a pose that is beyond_m deeper than the known_m that
// are known, at that depth: ln(U0 / U0(nodes)) then goes on with the slope it has there, ever less. False,
// and nothing is changed, where either has no contact.
bool make_layers_exact(ContactAnswer& answer, const ContactAnswer& layered, const LayeredTouch::At& exact,
                       double beyond_m = 0, double known_m = 0);

}  // namespace teletact::service
