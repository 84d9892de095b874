// The tissue of the paper's Figs. 12, 14 and 16 (T6.3).
#pragma once

#include "service/tissue/tissue_model.h"

namespace teletact::bench {

// 100 x 100 mm, 50 x 10 elements, five times stiffer in columns 22 to 27 of the two lowest rows.
inline service::TissueModel paper_tissue(double poisson_ratio) {
  service::TissueGrid grid{service::uniform_coordinates(0, 0.1, 50),
                           service::uniform_coordinates(0, 0.1, 10)};
  service::Material material{std::vector<double>(grid.elements(), 10e3), poisson_ratio};
  for (const std::size_t row : {8u, 9u})
    for (std::size_t column = 22; column < 28; ++column)
      material.youngs_modulus_pa[grid.element(column, row)] = 50e3;
  return {std::move(grid), std::move(material), {}, {}};
}

}  // namespace teletact::bench
