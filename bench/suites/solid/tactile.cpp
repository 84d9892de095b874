// What a tactile display shows of a lump (T8.6): images along a path over it, under a rounded tip and a pad,
// and how well an observer who knows both sees it beside homogeneous tissue at the same force.
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/solid_blocks.h"
#include "bench/suites/solid/solid.h"
#include "client/files/picture.h"
#include "service/contact/solid_contact.h"
#include "service/contact/tactile_image.h"
#include "service/device/device.h"

namespace teletact::bench {
namespace {

struct Image {
  double x_m = 0;  // of the tip, from the lump
  double force_n = 0, outside_n = 0;
  double detectability = 0;  // d', noise of 1/31.6 of the largest taxel
  std::vector<double> pressure_pa{}, beyond_pa{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Image, x_m, force_n, outside_n, detectability, pressure_pa, beyond_pa)

struct Tip {
  std::string name;
  std::vector<Image> images{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Tip, name, images)

struct Figures {
  std::vector<Tip> tips{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, tips)

constexpr double kIndentationM = 0.002, kNoise = 1 / 31.6;
constexpr service::TaxelGrid kTaxels;  // 8 x 8 of 2 mm

Image image_at(service::SolidContact<float>& contact, const service::SolidGrid& grid,
               const service::Fingertip& tip, double x_m) {
  const double middle_x_m = double(grid.nx) * grid.spacing_x_m / 2,
               middle_z_m = double(grid.nz) * grid.spacing_z_m / 2;
  const service::Vector3 pose{middle_x_m + x_m, kIndentationM, middle_z_m};
  const auto nodes = contact.touch(tip, pose).pressure;
  const service::Taxels with = share_among_taxels(nodes, kTaxels, {pose[0], pose[2]});
  const service::Taxels without =
      share_among_taxels(contact.layered_pressure(tip, pose, with.force_n), kTaxels, {pose[0], pose[2]});
  Image image{x_m, with.force_n, with.outside_n, 0, with.pressure_pa, with.pressure_pa};
  double squares = 0, largest = 0;
  for (std::size_t t = 0; t < with.pressure_pa.size(); ++t) {
    image.beyond_pa[t] -= without.pressure_pa[t];
    squares += image.beyond_pa[t] * image.beyond_pa[t];
    largest = std::max(largest, with.pressure_pa[t]);
  }
  image.detectability = std::sqrt(squares) / (kNoise * largest);
  return image;
}

Figures measure(bool quick, Promises& promises) {
  const service::SolidGrid grid = solid_grid(64, 64, 32, 0.001, 0.001);
  service::SolidContact<float> contact(
      service::Device::open()->queue(),
      solid_tissue(grid, 0.49, {.contrast = 5, .centre_m = {0, 0.010, 0}, .radius_m = 0.005}));
  const service::Fingertip round, pad{.shape = service::FingertipShape::kPad,
                                      .radius_m = 0.001,
                                      .half_width_m = 0.008,
                                      .pad_m_pa = 0.002 / 20e3};
  Figures f;
  for (const auto& [name, tip] : {std::pair{"rounded tip", round}, std::pair{"pad", pad}}) {
    Tip& t = f.tips.emplace_back(Tip{name});
    for (int k = -3; k <= 3; ++k) {
      if (quick && k != 0) continue;
      t.images.push_back(image_at(contact, grid, tip, 0.004 * k));
      const Image& image = t.images.back();
      std::printf(
          "tactile: %-11s %4.0f mm from the lump: %.3f N, %2.0f %% of it beside the taxels, d' %.1f\n", name,
          1e3 * image.x_m, image.force_n, 100 * image.outside_n / image.force_n, image.detectability);
      if (k == 0)
        promises.push_back({"lump_seen_under_the_" + snake_case(name), image.detectability,
                            t.name == "pad" ? 10.0 : 3.0, "1", false});
    }
  }
  return f;
}

void draw(const Figures& f, const std::filesystem::path& folder) {
  for (const Tip& tip : f.tips) {
    std::vector<client::Panel> panels;
    const auto add_row = [&](const char* what, const std::vector<double> Image::*values) {
      double high = 0;
      for (const Image& image : tip.images)
        for (const double value : image.*values) high = std::max(high, std::abs(value));
      for (const Image& image : tip.images) {
        client::Panel& panel = panels.emplace_back();
        char title[64];
        std::snprintf(title, sizeof(title), "%s %.0f mm", what, 1e3 * image.x_m);
        panel.title = title;
        panel.nx = kTaxels.along_x, panel.ny = kTaxels.along_z;
        panel.dx_m = panel.dy_m = kTaxels.pitch_m;
        panel.down = "z";
        panel.origin_x_m = image.x_m - kTaxels.pitch_m * double(kTaxels.along_x - 1) / 2;
        panel.origin_y_m = -kTaxels.pitch_m * double(kTaxels.along_z - 1) / 2;
        panel.values.assign((image.*values).begin(), (image.*values).end());
        panel.unit = "kPa", panel.factor = 1e-3;
        panel.low = values == &Image::beyond_pa ? -high : 0, panel.high = high;
      }
    };
    add_row("pressure", &Image::pressure_pa);
    add_row("beyond", &Image::beyond_pa);
    client::PictureOptions options;
    options.columns = tip.images.size();
    options.panel_width = 160;
    client::write_png(folder / ("solid_tactile_" + snake_case(tip.name) + ".png"), panels, options);
  }
}

}  // namespace

Part solid_tactile() {
  return make_part("tactile", measure, draw);
}

}  // namespace teletact::bench
