// SPDX-License-Identifier: Apache-2.0
// Results of the format readers for recording.cpp. Private to this folder.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "jade/recording/recording.h"

namespace jade::recording {

/// A folder for one conversion, removed with everything in it when the last user is gone.
class TemporaryFolder {
 public:
  /// @throws DataError if none can be made.
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

/// An image that has not been read yet.
struct FrameFile {
  std::filesystem::path path;
  /// Time span of its exposure; start and end are equal if only one time is known. None: no time.
  std::optional<events::TimeWindow> time;
};

/// Spans of the clock of a recording, in order and apart; none: all of it.
using Kept = std::optional<std::vector<events::TimeWindow>>;

/// Adds the events of these spans, and what there is to note about them, to a recording. Which
/// spans are wanted is known only once frames have their exposures.
using ReadEvents = std::function<void(const Kept& kept, Recording& recording)>;

/// A recording whose images are still files, and whose events are not read yet.
struct Contents {
  Recording recording;  ///< without frames and events
  std::vector<FrameFile> files;
  ReadEvents read_events;                 ///< empty: there are none
  std::shared_ptr<TemporaryFolder> keep;  ///< where the files are, if they are not the user's
};

Contents read_rpg(const std::filesystem::path& folder, const ReadOptions& options);
Contents read_rpg_zip(const std::filesystem::path& path, const ReadOptions& options);
Contents read_event_folder(const std::filesystem::path& folder, const ReadOptions& options);
Contents read_evt(const std::filesystem::path& path, const ReadOptions& options);
Contents read_dat(const std::filesystem::path& path, const ReadOptions& options);
Contents read_converted(const std::filesystem::path& path, const ReadOptions& options);
/// Last line that a failed program printed; empty if none.
std::string last_line(const std::filesystem::path& log);
/// Records of Metavision in HDF5, unless another group is asked for.
bool is_metavision(const std::filesystem::path& path, const std::string& group);
Contents read_metavision(const std::filesystem::path& path, const ReadOptions& options);
/// HDF5, .npz, .npy and text: events alone.
Contents read_event_file(const std::filesystem::path& path, const ReadOptions& options);

/// Adds the pictures, with their times, that an HDF5 file has of the camera of its events, and
/// notes those of others.
void add_hdf5_frames(const std::filesystem::path& path, const ReadOptions& options,
                     Contents& contents);

/// Gives each image the exposure that `exposures` has for its name, and notes exposures without an
/// image.
/// @throws DataError if an image has none, and as check_apart().
void apply_exposures(const std::filesystem::path& list, const std::vector<NamedExposure>& exposures,
                     std::vector<FrameFile>& files, std::vector<std::string>& notes);

/// Exposures of one camera follow each other. Overlaps of a twentieth of the frame period are
/// tolerated, as are longer ones of a tenth of the frames, which are noted.
/// @throws DataError naming `list` and two frames that are exposed at one time.
void check_apart(const std::filesystem::path& list, const std::vector<FrameFile>& files,
                 std::vector<std::string>& notes);

/// Reads images, on several threads, into recording.frames in order of time; those without a time
/// are left out. @throws DataError if one cannot be read, they differ in size, or they do not fit
/// into memory.
void read_frames(std::vector<FrameFile> files, Recording& recording);

/// Puts the images of a folder, or those of a video, in place of the recording's own. A folder may
/// hold exposures.csv, images.txt or timestamps.npz; frames of a video have its own clock, whose
/// zero is its beginning.
/// @throws DataError for a folder without images, a video that ffmpeg cannot read.
void replace_frames(const std::filesystem::path& path, const ReadOptions& options,
                    Contents& contents);

/// Without the mark of UTF-8 that spreadsheets put before the first line.
std::string without_mark(const std::string& text);

/// images.txt: a time in seconds and the path of an image, a line each. Notes images that are
/// listed twice or missing, and those of the folder that are not listed; they are left out.
/// @throws DataError naming the line.
std::vector<FrameFile> listed_images(const std::filesystem::path& list,
                                     std::vector<std::string>& notes);

/// The times of timestamps.npz beside images in order of their names.
/// @throws DataError if they are not as many.
void add_npz_times(const std::filesystem::path& path, events::TimeUnit unit,
                   std::vector<FrameFile>& files, Recording& recording);

/// Completes exposures from options and trigger edges where the recording's fields lack them.
/// @throws DataError for frames from elsewhere that are left without a time.
void complete_exposures(const ReadOptions& options, Contents& contents);

/// Takes the channel of the trigger input with the most edges, and notes the others.
void choose_channel(const std::filesystem::path& path, const std::map<int64_t, Triggers>& channels,
                    Recording& recording);

/// How the events of a file are read; what comes with them, such as triggers, is in `recording` at
/// once.
/// @param exposures  that tell the unit of times that the file does not
ReadEvents events_of(const std::filesystem::path& path, const ReadOptions& options,
                     const std::optional<events::TimeWindow>& exposures, Recording& recording);
ReadEvents events_of_evt(const std::filesystem::path& path, const ReadOptions& options,
                         Recording& recording);

/// Sets what there was besides the events that were kept, and says how many were left out.
/// @param most  that were to be kept, 0: all
void note_stored(int64_t events, const events::TimeWindow& span_us, int64_t most,
                 Recording& recording);

}  // namespace jade::recording
