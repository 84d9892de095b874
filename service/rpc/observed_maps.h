// What one who looks on has of a scene's maps, and what is new of them: in parts, so that a message holds no
// more than about kMaxBytes of them, and nothing is sent twice. Not thread-safe.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "service/rpc/cell_view.h"
#include "service/scene/scene.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

class ObservedMaps {
 public:
  static constexpr std::size_t kMaxBytes = std::size_t{1} << 20;

  // Throws std::invalid_argument for a name that no map has, or that stands twice.
  explicit ObservedMaps(const google::protobuf::RepeatedPtrField<std::string>& names);
  // Of a message at most: a block of columns and an image may go beyond kMaxBytes.
  static std::size_t max_bytes(const SceneSnapshot&, const SceneGeometry&);
  // The parts of this snapshot that are new, as many as a message holds. True: there are more.
  bool next(const SceneSnapshot&, const SceneGeometry&,
            google::protobuf::RepeatedPtrField<v1::ObservedMap>* out);

 private:
  bool images(const SceneSnapshot&, std::size_t& room,
              google::protobuf::RepeatedPtrField<v1::ObservedMap>* out);
  bool cells(const SceneSnapshot&, const SceneGeometry&, std::size_t& room,
             google::protobuf::RepeatedPtrField<v1::ObservedMap>* out);
  bool youngs_modulus_ = false, log_deviation_ = false, valid_ = false, b_mode_ = false;
  std::vector<std::uint64_t> sent_;                 // stamp of each block of columns (CellBlocks)
  std::shared_ptr<const ExplicitModulus> modulus_;  // that they are of; null: stitched
  std::map<std::uint64_t, std::shared_ptr<const BMode>> images_;  // the same of each window, by its id
};

}  // namespace teletact::service
