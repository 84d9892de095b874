// A solid scene that grows by slices as they are estimated: made with the first one, touchable from then on.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "client/acquire/estimate_client.h"
#include "client/acquire/solid_source.h"
#include "client/files/metaimage.h"
#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

// Elements of the tissue under the probe: x from the image's left border, z between the slices' middles.
struct SliceGrid {
  double width_m = 0, depth_m = 0, poisson_ratio = 0.49;
  SlicePlaces places;
  std::size_t columns() const;  // about 2 mm wide
  std::size_t rows() const;     // about 1 mm high
  double column_m() const { return width_m / static_cast<double>(columns()); }
  double row_m() const { return depth_m / static_cast<double>(rows()); }
};

// A slice on the grid, of each element, x fastest.
struct SlicePlane {
  std::vector<float> pa, log_std;  // Young's modulus; standard deviation of its logarithm
  // Changes of the logarithm by one deviation of each cause that is wrong in many places at once, one after
  // another; empty where the service told none.
  std::vector<float> log_modes = {};
};

// What an estimate's maps `youngs_modulus`, `youngs_modulus_log_std` and `valid` say of the elements: the
// mean of ln E and of its deviation over the nodes in each, and what `youngs_modulus_log_modes` (left out by
// an older service) says of its middle. One without a valid node continues the nearest that has some, with ln
// 2 more deviation, or, above it, that of its own modes. Throws ServiceError (FAILED_PRECONDITION) when
// nothing is valid.
SlicePlane slice_plane(const std::vector<teletact::v1::Map>& maps, const SliceGrid& grid);

struct PublishedSlice {
  std::uint64_t version = 0;  // the scene's, that has it
  std::vector<std::string> warnings;
};

// Used by one thread at a time.
class SliceScene {
 public:
  // `retry_for_s`: how long an UNAVAILABLE service is tried again.
  SliceScene(const std::shared_ptr<grpc::Channel>& channel, std::string scene_id, SliceGrid grid,
             double retry_for_s);

  // Publishes an estimate's maps as that slice, another time in its own place. Throws ServiceError, also
  // (CANCELLED) when `stop` becomes true between attempts.
  PublishedSlice publish(std::size_t slice, const std::vector<teletact::v1::Map>& maps,
                         const std::atomic<bool>& stop);

  bool made() const { return !planes_.empty(); }
  const std::map<std::size_t, SlicePlane>& planes() const { return planes_; }  // published, by slice

 private:
  grpc::Status create(const teletact::v1::ModulusSlice& slice, PublishedSlice& published);
  bool holds_only(const teletact::v1::ModulusSlice& slice);
  grpc::Status add(const teletact::v1::ModulusSlice& slice, PublishedSlice& published);

  std::unique_ptr<teletact::v1::Palpation::Stub> stub_;
  std::string scene_id_;
  SliceGrid grid_;
  double retry_for_s_;
  std::map<std::size_t, SlicePlane> planes_;
};

// Volumes of the published slices as the command `slices` takes them: of moduli (Pa), or of the deviations.
// Not a number where a slice is missing.
MetaImage slice_volume(const SliceGrid& grid, const std::map<std::size_t, SlicePlane>& planes,
                       std::vector<float> SlicePlane::*values);

}  // namespace teletact::client
