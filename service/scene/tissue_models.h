// What a scene is touched on: the tissue of a window, and the block of a solid that was given.
#pragma once

#include <memory>
#include <vector>

#include "service/contact/solid_touch_model.h"
#include "service/scene/geometry.h"
#include "service/scene/scene_record.h"
#include "service/scene/stitched_map.h"
#include "service/tissue/tissue_model.h"

namespace teletact::service {

struct WindowTissueOptions {
  bool interior_layers = false;  // as in TissueModelOptions
  MemoryAccount account = {};    // the same
};

// Node coordinates of the rows (y), the same for every window of a scene.
std::vector<double> window_rows_m(const SceneGeometry&);
// Node coordinates of the columns (x) for the window [begin, end).
std::vector<double> window_columns_m(const SceneGeometry&, double begin_m, double end_m);

// The tissue that a window [begin, end) is touched on (T4): the window with context on each side, on a graded
// grid (base/choices.h). Fine columns lie on one lattice of the whole scene, so that the tissues of two
// windows have the same nodes under a finger that is handed over from one to the other. Element modulus =
// harmonic mean over the map's cells (series model: exact for layers across the load, and unbiased for strain
// noise); edges of the grid inside the tissue are free, edges on the tissue's border as in the geometry.
// `before` (may be null): the model of the same window over an older map; what has not changed since is taken
// over.
std::shared_ptr<const TissueModel> build_window_tissue(const SceneGeometry&, const StitchedMap&,
                                                       double begin_m, double end_m,
                                                       const WindowTissueOptions& = {},
                                                       const TissueModel* before = nullptr);

// The block that a given solid modulus is touched on. Columns as they are given, evenly spaced; along z at
// most choices::kSolidSpacing apart, ln E interpolated between the slices, beyond which the outermost go on;
// rows as they are. Around it, to a power of two of columns, the outermost elements go on. Throws
// std::invalid_argument (field named).
SolidBlock solid_block(const SceneGeometry&, const ExplicitModulus&);
// The same where `before` was one slice less, or had another in this one's place; none: any may be another.
SolidBlock solid_block(const SolidBlock& before, const ExplicitModulus&, std::optional<std::size_t> slice);

}  // namespace teletact::service
