// Files of MATLAB and USTB as other programs write them (written/): hdf5storage 0.2.2, h5py 3.16, SciPy 1.17
// and pyuff-ustb 3.0.0, each of its own way.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include "client/files/matfile.h"
#include "client/files/uff.h"
#include "tests/files/matlab/write_uff.h"
#include "tests/files/refusal.h"
#include "tests/files/temporary_folder.h"
#include "tests/support/environment.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

fs::path written(const std::string& name) {
  return fs::path(test::required_environment("TELETACT_SOURCE_DIR")) / "tests/files/matlab/written" / name;
}

// 3 lines of 4 samples.
std::vector<float> counted(float first) {
  std::vector<float> out(12);
  for (std::size_t k = 0; k < out.size(); ++k) out[k] = first + 7.0F * static_cast<float>(k);
  return out;
}

TEST(MatFileOfOthers, BothFramesAsTwoVariablesAreRead) {
  for (const char* name : {"hdf5storage.mat", "h5py.mat", "scipy.mat"}) {
    const MatFrames pre = read_mat(written(name), "pre", AxialAxis::kRows),
                    post = read_mat(written(name), "post", AxialAxis::kRows);
    EXPECT_EQ(pre.sample_count, 4u) << name;
    EXPECT_EQ(pre.line_count, 3u) << name;
    EXPECT_EQ(pre.samples, counted(-30)) << name;
    EXPECT_EQ(post.samples, counted(970)) << name;
    const MatFrames turned = read_mat(written(name), "pre", AxialAxis::kColumns);
    EXPECT_EQ(turned.sample_count, 3u) << name;
    EXPECT_EQ(turned.samples[1], -30 + 7.0F * 4) << name;
  }
}

TEST(UffOfOthers, PyuffsPixelsComeFirst) {
  const UffImage image = read_uff(written("pyuff_ustb.uff"), "", 1);
  EXPECT_EQ(image.sample_count, 4u);
  EXPECT_EQ(image.line_count, 3u);
  EXPECT_EQ(image.frame_count, 2u);
  EXPECT_EQ(image.modulation_frequency_hz, 5.2e6) << "one number, of no dimensions";
  EXPECT_NEAR(image.first_sample_depth_m, 0.01, 1e-12);
  EXPECT_EQ(image.values, counted(970));
  EXPECT_EQ(image.imaginary, counted(1070));
  EXPECT_EQ(read_uff(written("pyuff_ustb.uff"), "", 0).values, counted(-30));
}

TEST(UffOfOthers, PixelsFirstWithoutFramesAreRead) {
  const TemporaryFolder folder;
  for (const std::vector<hsize_t>& extent :
       {std::vector<hsize_t>{12}, {12, 1}, {1, 12}, {12, 1, 1}, {12, 1, 1, 1}, {1, 1, 1, 12}}) {
    {
      UffFile file(folder / "a.uff");
      write_beamformed(file, "b_data", {3, 4, 3e-4, 2e-5, 0.01}, counted(5), {});
      file.remove("b_data/data");
      file.numbers("b_data/data", extent, counted(5));
    }
    EXPECT_EQ(read_uff(folder / "a.uff", "", 0).values, counted(5)) << extent.size() << " dimensions";
  }
}

// Held by another, as on a file system that knows no flock() HDF5 gets an error for it.
class LockedFile {
 public:
  explicit LockedFile(const fs::path& path) : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    EXPECT_EQ(::flock(file_, LOCK_EX | LOCK_NB), 0);
  }
  ~LockedFile() { ::close(file_); }
  LockedFile(const LockedFile&) = delete;
  LockedFile& operator=(const LockedFile&) = delete;

 private:
  int file_;
};

TEST(FilesOfOthers, AreReadWithoutTheirLock) {
  const TemporaryFolder folder;
  for (const char* name : {"hdf5storage.mat", "pyuff_ustb.uff"}) {
    fs::copy_file(written(name), folder / name);
    const LockedFile locked(folder / name);
    if (fs::path(name).extension() == ".uff")
      EXPECT_EQ(read_uff(folder / name, "", 0).values, counted(-30));
    else
      EXPECT_EQ(read_mat(folder / name, "pre", AxialAxis::kRows).samples, counted(-30));
  }
}

std::string message_of(const std::string& name) {
  return refusal_of<FileError>([&] { read_mat(written(name), "pre", AxialAxis::kRows); });
}

TEST(FilesOfOthers, AFilterThatIsNotHereIsNamed) {
  EXPECT_NE(message_of("h5py_lzf.mat").find("'pre' is packed by the filter 'lzf', which is not here"),
            std::string::npos)
      << message_of("h5py_lzf.mat");
}

TEST(FilesOfOthers, OneThatItsWriterNeverClosedIsNamed) {
  EXPECT_NE(message_of("h5py_left_open.mat").find("was not closed by the program that wrote it"),
            std::string::npos)
      << message_of("h5py_left_open.mat");
}

}  // namespace
}  // namespace teletact::client
