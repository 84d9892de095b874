// Images of USTB: what is read, what is refused and in which words, and what a hostile file can do.
#include "client/files/uff.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "tests/files/matlab/hostile_files.h"
#include "tests/files/matlab/write_uff.h"
#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

constexpr UffScan kScan{5, 40, 3e-4, 5e-5, 0.01};
constexpr std::size_t kPixels = 5 * 40;

std::vector<float> counted(std::size_t count, float first) {
  std::vector<float> out(count);
  std::iota(out.begin(), out.end(), first);
  return out;
}

void write_example(UffFile& file, const std::string& at = "b_data") {
  write_beamformed(file, at, kScan, counted(2 * kPixels, 0), counted(2 * kPixels, 1000));
}

std::string message_of(const fs::path& path, const std::string& object = "") {
  try {
    read_uff(path, object, 0);
  } catch (const FileError& error) {
    EXPECT_EQ(error.path, path);
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "no error";
}

TEST(Uff, ComplexFramesAreReadWithTheirGeometry) {
  const TemporaryFolder folder;
  {
    UffFile file(folder / "a.uff");
    write_example(file);
    file.number("b_data/modulation_frequency", 5.2e6);
    file.group("b_data/sequence", "uff.wave", true);
    for (const char* wave : {"b_data/sequence/sequence_0001", "b_data/sequence/sequence_0002"}) {
      file.group(wave, "uff.wave");
      file.number(wave + std::string("/sound_speed"), 1480);
    }
    file.axis("b_data/scan/y_axis", 0, 1, 1);
  }
  const UffImage image = read_uff(folder / "a.uff", "", 1);
  EXPECT_EQ(image.sample_count, 40u);
  EXPECT_EQ(image.line_count, 5u);
  EXPECT_EQ(image.frame_count, 2u);
  EXPECT_NEAR(image.line_pitch_m, 3e-4, 1e-9);
  EXPECT_NEAR(image.sample_pitch_m, 5e-5, 1e-9);
  EXPECT_NEAR(image.first_sample_depth_m, 0.01, 1e-8);
  EXPECT_EQ(image.modulation_frequency_hz, 5.2e6);
  EXPECT_EQ(image.sound_speed_m_s, 1480);
  EXPECT_EQ(image.values, counted(kPixels, kPixels));
  EXPECT_EQ(image.imaginary, counted(kPixels, kPixels + 1000));
  EXPECT_EQ(read_uff(folder / "a.uff", "b_data", 0).values, counted(kPixels, 0));
  EXPECT_EQ(read_uff(folder / "a.uff", "/b_data", 99).values, image.values) << "the last";
}

TEST(Uff, RealFramesAreReadAndNamesOfVariableLengthToo) {
  const TemporaryFolder folder;
  {
    UffFile file(folder / "a.uff");
    write_beamformed(file, "b_data", kScan, counted(kPixels, 7), {});
    const hid_t object = H5Oopen(file.id, "b_data", H5P_DEFAULT);
    H5Adelete(object, "class"), H5Oclose(object);
    file.text("b_data", "class", "uff.beamformed_data", true);
  }
  const UffImage image = read_uff(folder / "a.uff", "", 0);
  EXPECT_EQ(image.frame_count, 1u);
  EXPECT_EQ(image.values, counted(kPixels, 7));
  EXPECT_TRUE(image.imaginary.empty());
  EXPECT_FALSE(image.modulation_frequency_hz);
  EXPECT_FALSE(image.sound_speed_m_s);
}

TEST(Uff, OneOfSeveralObjectsIsNamed) {
  const TemporaryFolder folder;
  {
    UffFile file(folder / "a.uff");
    write_example(file, "one");
    write_example(file, "two");
    file.group("several", "uff.beamformed_data", true);
    write_example(file, "several/several_0001");
    file.group("raw", "uff.channel_data");
  }
  EXPECT_NE(message_of(folder / "a.uff").find("give one with --variable: one, "), std::string::npos);
  EXPECT_EQ(message_of(folder / "a.uff", "two"), "no error");
  EXPECT_EQ(message_of(folder / "a.uff", "several/several_0001"), "no error");
  EXPECT_NE(message_of(folder / "a.uff", "several").find("--variable, such as several/several_0001"),
            std::string::npos);
  EXPECT_NE(message_of(folder / "a.uff", "three").find("no object 'three'; it has: one, raw, several, two"),
            std::string::npos);
  EXPECT_NE(message_of(folder / "a.uff", "raw").find("holds channel data (uff.channel_data); beamform it"),
            std::string::npos);
  EXPECT_NE(message_of(folder / "a.uff", "one/scan").find("is of the class 'uff.linear_scan'"),
            std::string::npos);
}

TEST(Uff, ChannelDataAloneAreRefusedByName) {
  const TemporaryFolder folder;
  {
    UffFile file(folder / "a.uff");
    file.group("channel_data", "uff.channel_data");
  }
  EXPECT_NE(
      message_of(folder / "a.uff").find("'channel_data' holds channel data (uff.channel_data); beamform it"),
      std::string::npos)
      << message_of(folder / "a.uff");
}

// A good file, then one thing that is wrong with it, and what is said.
struct Wrong {
  const char* name;
  std::function<void(UffFile&)> make;
  const char* said;
};

void PrintTo(const Wrong& wrong, std::ostream* out) {
  *out << wrong.name;
}

class WrongUff : public testing::TestWithParam<Wrong> {};

TEST_P(WrongUff, IsRefusedInOneSentence) {
  const TemporaryFolder folder;
  {
    UffFile file(folder / "a.uff");
    write_example(file);
    GetParam().make(file);
  }
  const std::string message = message_of(folder / "a.uff");
  EXPECT_NE(message.find(GetParam().said), std::string::npos) << message;
}

void other_scan(UffFile& file, const char* kind) {
  file.remove("b_data/scan");
  file.group("b_data/scan", kind);
}

void other_data(UffFile& file, const std::vector<hsize_t>& extent, bool filled = true) {
  file.remove("b_data/data");
  std::size_t values = 1;
  for (const hsize_t n : extent) values *= filled ? n : 1;
  file.numbers("b_data/data", extent, filled ? counted(values, 0) : std::vector<float>{});
}

void other_axis(UffFile& file, const char* axis, const std::vector<float>& places) {
  file.remove(std::string("b_data/scan/") + axis);
  file.numbers(std::string("b_data/scan/") + axis, {1, places.size()}, places);
}

void in_another_file(UffFile& file) {
  file.remove("b_data/data");
  const hid_t made = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_external(made, "/etc/passwd", 0, kPixels * sizeof(float));
  file.numbers("b_data/data", {1, kPixels}, {}, made);
  H5Pclose(made);
}

// One that could be read.
void scan_in_another_file(UffFile& file) {
  std::string other(static_cast<std::size_t>(H5Fget_name(file.id, nullptr, 0)), '\0');
  H5Fget_name(file.id, other.data(), other.size() + 1);
  other += "2";
  UffFile good(other);
  write_example(good);
  file.remove("b_data/scan");
  H5Lcreate_external(other.c_str(), "/b_data/scan", file.id, "b_data/scan", H5P_DEFAULT, H5P_DEFAULT);
}

const float kNan = std::nanf("");

INSTANTIATE_TEST_SUITE_P(
    All, WrongUff,
    testing::Values(Wrong{"NoObject", [](UffFile& f) { f.remove("b_data"); }, "holds no uff.beamformed_data"},
                    Wrong{"NoScan", [](UffFile& f) { f.remove("b_data/scan"); }, "'b_data/scan' is missing"},
                    Wrong{"Sector", [](UffFile& f) { other_scan(f, "uff.sector_scan"); },
                          "'b_data/scan' is a 'uff.sector_scan'; A-lines must be parallel"},
                    Wrong{"Rotated", [](UffFile& f) { other_scan(f, "uff.linear_scan_rotated"); },
                          "uff.linear_scan_rotated"},
                    Wrong{"Scans",
                          [](UffFile& f) {
                            f.remove("b_data/scan");
                            f.group("b_data/scan", "uff.linear_scan", true);
                          },
                          "several scans"},
                    Wrong{"Volume", [](UffFile& f) { f.axis("b_data/scan/y_axis", 0, 1e-3, 3); },
                          "'b_data/scan/y_axis' has several places"},
                    Wrong{"Moved",
                          [](UffFile& f) {
                            f.numbers("b_data/scan/z", {1, kPixels}, std::vector<float>(kPixels, 0.01F));
                          },
                          "'b_data/scan/z' is not what the axes say"},
                    Wrong{"NoAxis", [](UffFile& f) { f.remove("b_data/scan/z_axis"); },
                          "'b_data/scan/z_axis' is missing"},
                    Wrong{"Uneven",
                          [](UffFile& f) {
                            other_axis(f, "x_axis", {0, 1, 2, 4, 5});
                          },
                          "'b_data/scan/x_axis' is not evenly spaced"},
                    Wrong{"Falls",
                          [](UffFile& f) {
                            other_axis(f, "x_axis", {5, 4, 3, 2, 1});
                          },
                          "does not rise"},
                    Wrong{"OnePlace", [](UffFile& f) { other_axis(f, "x_axis", {0}); }, "has 1 places"},
                    Wrong{"AboveTheProbe",
                          [](UffFile& f) {
                            other_axis(f, "z_axis", {-1, 0, 1});
                          },
                          "begins above the probe"},
                    Wrong{"NanOnAnAxis",
                          [](UffFile& f) {
                            other_axis(f, "x_axis", {0, 1, kNan, 3, 4});
                          },
                          "'b_data/scan/x_axis' holds NaN"},
                    Wrong{"NoData", [](UffFile& f) { f.remove("b_data/data"); }, "'b_data/data' is missing"},
                    Wrong{"NoImaginary", [](UffFile& f) { f.remove("b_data/data/imag"); },
                          "'b_data/data/imag' is missing"},
                    Wrong{"OtherPixels",
                          [](UffFile& f) {
                            other_data(f, {1, kPixels - 1});
                          },
                          "has 199 pixels, the scan 40 x 5"},
                    Wrong{"Channels",
                          [](UffFile& f) {
                            other_data(f, {1, 1, 7, kPixels});
                          },
                          "7 channels and 1 waves"},
                    Wrong{"Waves",
                          [](UffFile& f) {
                            other_data(f, {1, 11, 1, kPixels});
                          },
                          "1 channels and 11 waves"},
                    Wrong{"FiveDimensions",
                          [](UffFile& f) {
                            other_data(f, {1, 1, 1, 1, kPixels});
                          },
                          "has 5 dimensions"},
                    Wrong{"NoFrames",
                          [](UffFile& f) {
                            other_data(f, {0, 1, 1, kPixels}, false);
                          },
                          "is empty"},
                    Wrong{"OtherImaginary",
                          [](UffFile& f) {
                            f.remove("b_data/data/imag");
                            f.numbers("b_data/data/imag", {1, kPixels}, counted(kPixels, 0));
                          },
                          "another size than the real part"},
                    Wrong{"Nan",
                          [](UffFile& f) {
                            f.remove("b_data/data");
                            std::vector<float> values = counted(kPixels, 0);
                            values[77] = kNan;
                            f.numbers("b_data/data", {1, kPixels}, values);
                          },
                          "'b_data/data' holds NaN or infinity"},
                    Wrong{"Texts",
                          [](UffFile& f) {
                            f.remove("b_data/data");
                            f.group("b_data/data", "");
                            const hid_t space = H5Screate(H5S_SCALAR), type = H5Tcopy(H5T_C_S1);
                            H5Dclose(H5Dcreate2(f.id, "b_data/data/real", type, space, H5P_DEFAULT,
                                                H5P_DEFAULT, H5P_DEFAULT));
                            H5Tclose(type), H5Sclose(space);
                          },
                          "'b_data/data/real' holds no real numbers"},
                    Wrong{"SeveralFrequencies",
                          [](UffFile& f) { f.axis("b_data/modulation_frequency", 1, 1, 2); },
                          "'b_data/modulation_frequency' holds several numbers"},
                    Wrong{"NegativeFrequency",
                          [](UffFile& f) { f.number("b_data/modulation_frequency", -1); }, "is below 0"},
                    // What HDF5 would follow to other files.
                    Wrong{"DataElsewhere", in_another_file, "'b_data/data' lies in another file"},
                    Wrong{"LinkedElsewhere", scan_in_another_file, "'b_data/scan' is missing"},
                    Wrong{"LinkedInCircles",
                          [](UffFile& f) {
                            f.remove("b_data/scan");
                            H5Lcreate_soft("/b_data/scan", f.id, "b_data/scan", H5P_DEFAULT, H5P_DEFAULT);
                          },
                          "'b_data/scan' is missing"},
                    // More than the file can hold: nothing of it was written.
                    Wrong{"HugeAxes",
                          [](UffFile& f) {
                            f.remove("b_data/scan/x_axis");
                            f.numbers("b_data/scan/x_axis", {1, hsize_t{1} << 40}, {});
                          },
                          "claims to be larger than the file can hold"},
                    Wrong{"HugeData",
                          [](UffFile& f) {
                            other_axis(f, "z_axis", counted(10'000, 0));
                            other_axis(f, "x_axis", counted(1'000, 0));
                            other_data(f, {1, 10'000'000}, false);
                          },
                          "claims to be larger than the file can hold"},
                    Wrong{"HugeImage",
                          [](UffFile& f) {
                            other_axis(f, "z_axis", counted(10'000, 0));
                            other_axis(f, "x_axis", counted(10'000, 0));
                          },
                          "'b_data/scan' has 10000 x 10000 pixels"},
                    Wrong{"HugeFrames",
                          [](UffFile& f) {
                            f.remove("b_data/data");
                            f.numbers("b_data/data", {hsize_t{1} << 50, 1, 1, kPixels}, {});
                          },
                          "claims to be larger than the file can hold"}),
    [](const auto& info) { return info.param.name; });

TEST(Uff, WhatIsNoHdf5OrIsCutAnywhereIsRefused) {
  const TemporaryFolder folder;
  EXPECT_NE(message_of(folder / "absent.uff").find("does not exist"), std::string::npos);
  put_content(folder / "noise.uff", std::string(5000, 'x'));
  EXPECT_NE(message_of(folder / "noise.uff").find("is not an HDF5 file or is damaged"), std::string::npos);
  {
    UffFile file(folder / "a.uff");
    write_example(file);
  }
  const std::string whole = content_of(folder / "a.uff");
  for (std::size_t bytes = 0; bytes < whole.size(); bytes += whole.size() / 13) {
    put_content(folder / "cut.uff", whole.substr(0, bytes));
    EXPECT_NE(message_of(folder / "cut.uff"), "no error") << bytes << " of " << whole.size();
  }
}

// By fuzzers: what makes HDF5 read beyond what there is. It ends their parser at most.
TEST(Uff, HostileOnesThatWereFoundAreRefused) {
  int found = 0;
  for (const auto& entry : fs::directory_iterator(hostile_files())) {
    if (entry.path().extension() != ".uff") continue;
    ++found;
    EXPECT_NE(message_of(entry.path()), "no error") << entry.path();
  }
  EXPECT_EQ(found, 2);
}

TEST(Uff, NamesInItCannotDrawOnTheTerminal) {
  const TemporaryFolder folder;
  {
    UffFile file(folder / "a.uff");
    file.group("a\x1b[2J\n", "uff.beamformed_data");
    file.group("b\x1b[2J\n", "uff.beamformed_data");
  }
  for (const char* object : {"", "none"})
    EXPECT_EQ(message_of(folder / "a.uff", object).find_first_of("\x1b\n"), std::string::npos);
}

}  // namespace
}  // namespace teletact::client
