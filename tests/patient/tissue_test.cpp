#include "client/patient/tissue.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <limits>
#include <set>

#include "client/files/file_io.h"

namespace teletact::client {
namespace {

std::string message_of(const std::string& toml) {
  try {
    parse_tissue(toml, "t.toml");
  } catch (const TissueError& error) {
    return error.what();
  }
  return "no error";
}

TEST(TissueFile, EmptyFileIsTheDefaultTissue) {
  const Tissue t = parse_tissue("");
  EXPECT_EQ(t.width_m, .3);
  EXPECT_EQ(t.depth_m, .04);
  EXPECT_EQ(t.youngs_modulus_pa, 10e3);
  EXPECT_EQ(t.poisson_ratio, .49);
  EXPECT_DOUBLE_EQ(t.probe.compression_m, .0004);
  EXPECT_TRUE(t.inclusions.empty());
}

TEST(TissueFile, ReadsBackWhatWasWritten) {
  const auto path =
      std::filesystem::temp_directory_path() / ("teletact-tissue-" + std::to_string(::getpid()) + ".toml");
  Tissue t = random_tissue(7);
  t.probe.lines = 192;
  t.ultrasound.snr_db = 1.0 / 3;
  t.probe.compression_m = .00123;
  write_tissue(path, t);
  const Tissue read = read_tissue(path);
  std::filesystem::remove(path);
  ASSERT_EQ(read.inclusions.size(), t.inclusions.size());
  for (std::size_t i = 0; i < t.inclusions.size(); ++i) {
    EXPECT_EQ(read.inclusions[i].x_m, t.inclusions[i].x_m);
    EXPECT_EQ(read.inclusions[i].y_m, t.inclusions[i].y_m);
    EXPECT_EQ(read.inclusions[i].diameter_m, t.inclusions[i].diameter_m);
    EXPECT_EQ(read.inclusions[i].contrast, t.inclusions[i].contrast);
  }
  EXPECT_EQ(read.seed, 7u);
  EXPECT_EQ(read.probe.lines, 192u);
  EXPECT_EQ(read.probe.compression_m, t.probe.compression_m);
  EXPECT_EQ(read.ultrasound.snr_db, t.ultrasound.snr_db);
  EXPECT_EQ(read.ultrasound.sampling_frequency_hz, 40e6);
}

TEST(TissueFile, ReadsBackEverySolid) {
  const auto path =
      std::filesystem::temp_directory_path() / ("teletact-solid-" + std::to_string(::getpid()) + ".toml");
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    Tissue t = unlike_model(seed);
    t.solid->texture_length_m = 1.0 / 301, t.solid->bottom_contrast = 1.0 / 7;
    write_tissue(path, t);
    const Tissue read = read_tissue(path);
    EXPECT_EQ(read.solid, t.solid) << seed;
    EXPECT_EQ(read.inclusions, t.inclusions) << seed;
    EXPECT_EQ(read.probe, t.probe) << seed;
    EXPECT_EQ(read.ultrasound, t.ultrasound) << seed;
    EXPECT_EQ(read.depth_m, t.depth_m);
    EXPECT_EQ(read.poisson_ratio, t.poisson_ratio);
  }
  std::filesystem::remove(path);
  EXPECT_FALSE(parse_tissue("").solid);
  EXPECT_TRUE(parse_tissue("[solid]").solid);
  EXPECT_EQ(parse_tissue("[solid]\nfriction = inf").solid->friction, std::numeric_limits<double>::infinity());
}

TEST(TissueFile, EachErrorNamesItsKey) {
  struct Case {
    const char *toml, *key, *word;
  };
  for (const Case& c :
       {Case{"sead = 1", "sead", "unknown"},
        {"[tissue]\nwidth = 0.3", "tissue.width", "width_m"},
        {"[probe]\nlines = 12.5", "probe.lines", "whole"},
        {"[probe]\nlines = -1", "probe.lines", "whole"},
        {"[probe]\ncompression_m = 1e-3\ncompression_strain = 0.01", "probe.compression_strain", "both"},
        {"[probe]\ncompression_strain = 0.5", "probe.compression_m", "tenth"},
        {"[probe]\nwidth_m = 0.5", "probe.width_m", "must be"},
        {"[tissue]\npoisson_ratio = 0.5", "tissue.poisson_ratio", "0.4999"},
        {"[tissue]\nyoungs_modulus_pa = -1", "tissue.youngs_modulus_pa", "must be"},
        {"[tissue]\ndepth_m = nan", "tissue.depth_m", "number"},
        {"[tissue]\ndepth_m = \"4\"", "tissue.depth_m", "number"},
        {"tissue = 3", "tissue", "table"},
        {"inclusion = 3", "inclusion", "list"},
        {"[[inclusion]]\ndiameter_m = 0.01\ncontrast = 3", "inclusion[0].position_m", "missing"},
        {"[[inclusion]]\nposition_m = [1]\ndiameter_m = 0.01\ncontrast = 3", "inclusion[0].position_m",
         "[x, y]"},
        {"[[inclusion]]\nposition_m = [0.1, 0.01]\ndiameter_m = 0.01\ncontrast = 3\nshape = \"cube\"",
         "inclusion[0].shape", "sphere"},
        {"[[inclusion]]\nposition_m = [0.1, 0.01]\ndiameter_m = 0.01\ncontrast = 3\nshape = \"sphere\"",
         "inclusion[0].shape", "[solid]"},
        {"[solid]\nsupport = \"air\"", "solid.support", "bonded, sliding, bed"},
        {"[solid]\nelevational_width_m = 0.001", "solid.elevational_width_m", "must be"},
        {"[solid]\nfriction = nan", "solid.friction", "number"},
        {"[solid]\nlean_m = 0.01", "solid.lean_m", "must be"},
        {"[solid]\nbottom_contrast = 0", "solid.bottom_contrast", "must be"},
        {"[ultrasound]\ndepth_m = 0.05", "ultrasound.depth_m", "must be"},
        {"[ultrasound]\nattenuation_db_cm_mhz = 2", "ultrasound.attenuation_db_cm_mhz", "centre frequency"},
        {"[[inclusion]]\nposition_m = [1, 0]\ndiameter_m = 0.01\ncontrast = 3", "inclusion[0].position_m[0]",
         "must be"},
        {"[[inclusion]]\nposition_m = [0.1, 0.01]\ndiameter_m = 0.01\ncontrast = 0", "inclusion[0].contrast",
         "must be"},
        {"[ultrasound]\nsampling_frequency_hz = 1e7", "ultrasound.sampling_frequency_hz", "at least"},
        {"[ultrasound]\ncorrelation = 1.2", "ultrasound.correlation", "must be"},
        {"[tissue\n", "t.toml:1", "TOML"}}) {
    const std::string message = message_of(c.toml);
    EXPECT_NE(message.find(c.key), std::string::npos) << c.toml << " -> " << message;
    EXPECT_NE(message.find(c.word), std::string::npos) << c.toml << " -> " << message;
    EXPECT_NE(message.find("t.toml"), std::string::npos);
  }
  EXPECT_THROW(read_tissue("/nonexistent/t.toml"), FileError);
}

TEST(Tissue, TrueModulusIsASharpDisc) {
  Tissue t;
  t.inclusions = {{.1, .02, .01, 5}};
  EXPECT_EQ(t.true_modulus(.1, .02), 50e3);
  EXPECT_EQ(t.true_modulus(.1049, .02), 50e3);
  EXPECT_EQ(t.true_modulus(.1051, .02), 10e3);
}

TEST(RandomTissue, KeepsItsRulesForEverySeed) {
  std::set<std::size_t> counts;
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    const Tissue t = random_tissue(seed);
    EXPECT_NO_THROW(validate(t));
    counts.insert(t.inclusions.size());
    ASSERT_GE(t.inclusions.size(), 3u);
    int across = 0;
    for (std::size_t a = 0; a < t.inclusions.size(); ++a) {
      const Inclusion& i = t.inclusions[a];
      const double r = i.diameter_m / 2;
      EXPECT_GE(i.diameter_m, .008);
      EXPECT_LE(i.diameter_m, .015);
      EXPECT_GE(i.contrast, 3);
      EXPECT_LE(i.contrast, 10);
      EXPECT_GT(i.y_m - r, 0);
      EXPECT_LE(i.y_m + r, .025 + 1e-12);
      EXPECT_GT(i.x_m - r, 0);
      EXPECT_LT(i.x_m + r, t.width_m);
      for (int k = 1; k <= 4; ++k) across += std::abs(i.x_m - .06 * k) < r;
      for (std::size_t b = 0; b < a; ++b) {
        const Inclusion& o = t.inclusions[b];
        EXPECT_GE(std::hypot(i.x_m - o.x_m, i.y_m - o.y_m) - r - o.diameter_m / 2, .015) << seed;
        EXPECT_NE(i.diameter_m, o.diameter_m);
        EXPECT_NE(i.contrast, o.contrast);
        EXPECT_NE(i.y_m, o.y_m);
      }
    }
    EXPECT_EQ(across, 1) << seed;
  }
  EXPECT_EQ(counts, (std::set<std::size_t>{3, 4, 5}));
}

TEST(RandomTissue, OfASolidKeepsItsRulesForEverySeed) {
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    const Tissue t = random_solid_tissue(seed);
    ASSERT_NO_THROW(validate(t)) << seed;
    EXPECT_EQ(t, random_solid_tissue(seed));
    ASSERT_EQ(t.inclusions.size(), 3u);
    for (const Inclusion& i : t.inclusions) {
      EXPECT_TRUE(i.sphere && i.contrast >= 3 && i.diameter_m >= .008) << seed;
      EXPECT_LE(i.y_m + i.diameter_m / 2, .02 + 1e-12) << seed;
      EXPECT_LE(std::max(std::abs(i.x_m - t.width_m / 2), std::abs(i.z_m)), .018) << seed;
      for (const Inclusion& other : t.inclusions) {
        if (other == i) continue;
        EXPECT_GE(std::hypot(i.x_m - other.x_m, i.y_m - other.y_m, i.z_m - other.z_m),
                  (i.diameter_m + other.diameter_m) / 2 + .006 - 1e-12)
            << seed;
      }
    }
  }
  EXPECT_NE(random_solid_tissue(1), random_solid_tissue(2));
}

TEST(UnlikeModel, DrawsWhatIsAllowedOfEveryOption) {
  std::set<Support> supports;
  int held = 0, slides = 0, rubs = 0, narrow = 0, leans = 0, capsules = 0, spheres = 0, deeper = 0;
  constexpr int kSeeds = 200;
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    const Tissue t = unlike_model(seed);
    EXPECT_NO_THROW(validate(t)) << seed;
    const Solid& s = *t.solid;
    supports.insert(s.support);
    held += std::isinf(s.friction), slides += s.friction == 0, rubs += s.friction > 0 && s.friction < 1;
    narrow += t.width_m == t.probe.width_m, leans += s.lean_m != 0, capsules += s.capsule_m > 0;
    spheres += t.inclusions[0].sphere, deeper += t.depth_m > t.imaged_depth_m();
    EXPECT_GE(s.preload_m, .0015);
    EXPECT_LE(std::abs(s.uneven), .1);
    EXPECT_GE(s.texture, .05);
    EXPECT_LE(s.texture, .2);
    EXPECT_GE(t.ultrasound.elevation_beam_m, .001);
    EXPECT_LE(t.ultrasound.elevation_beam_m, .003);
    EXPECT_NE(t.probe.force_gain_error, 0);
  }
  EXPECT_EQ(supports.size(), 3u);
  for (const int n : {held, slides, rubs, narrow, capsules, spheres, deeper}) {
    EXPECT_GT(n, kSeeds / 10);
    EXPECT_LT(n, kSeeds * 7 / 10);
  }
  EXPECT_GT(leans, 5);
  EXPECT_EQ(unlike_model(3), unlike_model(3));
  EXPECT_EQ(unlike_model(3, 5).inclusions[0].contrast, 5);
  EXPECT_EQ(unlike_model(3, 5).solid, unlike_model(3).solid);
}

TEST(RandomTissue, SameSeedSamePatient) {
  EXPECT_EQ(random_tissue(3).inclusions[1].x_m, random_tissue(3).inclusions[1].x_m);
  EXPECT_NE(random_tissue(3).inclusions[1].x_m, random_tissue(4).inclusions[1].x_m);
}

}  // namespace
}  // namespace teletact::client
