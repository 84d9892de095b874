// A scene's maps, put together from the parts that Palpation.Observe sends, as the page draws them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "client/watch/frame.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::client {

class SceneMaps {
 public:
  static constexpr std::size_t kMaxCells = 4 << 20;
  static constexpr std::size_t kMaxImages = 256, kMaxNodes = 1 << 20,
                               kMaxImageBytes = 64 << 20;  // of images

  void clear();
  // Of this scene from now on, and with its own maps where it has them; images of windows that it has no more
  // are forgotten.
  void take(const v1::Scene& scene);
  // False: it is malformed, lies beyond the scene or is of no map that is drawn, and nothing has changed.
  bool take(const v1::ObservedMap& part);
  // Whether there is one; what changed since the last time.
  bool cells_changed() { return std::exchange(cells_changed_, false); }
  bool images_changed() { return std::exchange(images_changed_, false); }
  // "modulus_pa", "log_std", "valid" [ny][nx] and where they lie.
  Slot cells() const;
  // "b_mode" [ny][nx] of each window, those drawn last behind, where each lies, and its number, that no other
  // image ever has. Where there are too many the one drawn longest ago goes.
  Slot images() const;

 private:
  struct Grid {
    std::size_t nx, ny;
    double origin_m[2], spacing_m[2];
  };
  static std::optional<Grid> grid_of(const v1::Map& map);
  void take_whole(const v1::Scene& scene);
  bool take_cells(const Grid& part, const v1::Map& map);
  bool take_image(const Grid& part, const v1::ObservedMap& map);
  void make_room();

  struct Image {
    Grid grid;
    std::uint64_t version, drawn;
    std::vector<std::uint8_t> grey;
  };
  double width_m_ = 0;
  std::uint64_t version_ = 0, drawn_ = 0;
  std::optional<Grid> grid_;  // of the cells
  std::vector<float> modulus_pa_, log_deviation_;
  std::vector<std::uint8_t> valid_;
  std::map<std::uint64_t, Image> images_;  // by window
  bool cells_changed_ = false, images_changed_ = false;
};

}  // namespace teletact::client
