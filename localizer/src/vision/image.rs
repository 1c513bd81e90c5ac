//! Images in memory, PNG files, and JPEG files of cameras that write such.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use common::geometry::PinholeCamera;
use fast_image_resize::images::{Image, ImageRef};
use fast_image_resize::{FilterType, PixelType, ResizeAlg, ResizeOptions, Resizer};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::{Error, Plane};

/// A colour image, row by row, three bytes per pixel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RgbImage {
    width: usize,
    data: Vec<u8>,
}

impl RgbImage {
    /// An image of `data` rows of `width` pixels, three bytes each; none where
    /// they do not fill whole rows.
    pub fn new(width: usize, data: Vec<u8>) -> Option<Self> {
        (width > 0 && data.len().is_multiple_of(3 * width)).then_some(Self { width, data })
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.data.len() / (3 * self.width)
    }

    /// All values: red, green, blue of the first pixel of the first row, ...
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// One row, red, green, blue of its first pixel first; empty outside.
    pub fn row(&self, y: usize) -> &[u8] {
        self.data.get(3 * y * self.width..3 * (y + 1) * self.width).unwrap_or_default()
    }

    /// Its brightness: the mean of red, green and green, and blue, as the
    /// sensor has twice as many green pixels.
    pub fn grey(&self) -> Plane {
        let mut plane = Plane::zeros(self.width, self.height());
        for (grey, rgb) in plane.data_mut().iter_mut().zip(self.data.chunks_exact(3)) {
            *grey = ((u16::from(rgb[0]) + 2 * u16::from(rgb[1]) + u16::from(rgb[2]) + 2) / 4) as u8;
        }
        plane
    }

    /// The same image of another size, each pixel the mean of what it covers; as it is
    /// where that is its own.
    #[must_use]
    pub fn resized(self, (width, height): (usize, usize)) -> Self {
        if (width, height) == (self.width, self.height()) {
            return self;
        }
        let size = (self.width, self.height());
        Self { width, data: resized(&self.data, PixelType::U8x3, size, (width, height)) }
    }

    /// The three bytes of a pixel, none outside the image.
    pub fn pixel_mut(&mut self, x: usize, y: usize) -> Option<&mut [u8]> {
        if x >= self.width {
            return None;
        }
        let at = 3 * (y * self.width + x);
        self.data.get_mut(at..at + 3)
    }
}

/// Values of an image of `from` columns and rows as one of `to`: each the mean of
/// what it covers, weighed by how near that is.
pub(super) fn resized(values: &[u8], kind: PixelType, from: (usize, usize), to: (usize, usize)) -> Vec<u8> {
    let [columns, rows, width, height] = [from.0, from.1, to.0, to.1].map(|side| side as u32);
    let mut out = Image::new(width, height, kind);
    let options = ResizeOptions::new().resize_alg(ResizeAlg::Convolution(FilterType::Bilinear));
    if let Ok(image) = ImageRef::new(columns, rows, values, kind) {
        // It fails for other kinds of pixels, and for no pixels, which stay black.
        let _ = Resizer::new().resize(&image, &mut out, &options);
    }
    out.into_vec()
}

/// Largest distance of the principal point from the middle column of an image
/// that was not scaled, as a share of its width: rectified KITTI images have at
/// most 0.02, an image of twice the size has 0.25, one of half of it 0.5.
const OFF_CENTRE: f64 = 0.2;

/// Checks that an image of this size can be the one that `camera` was
/// calibrated for. KITTI's calibration files do not say the size, so this
/// asks that the optical axis meets the image, and near its middle column: sky
/// and bonnet are often cut off, the sides hardly ever.
///
/// # Errors
/// [`Error::OffCentre`] where it does not.
pub fn check_calibration(path: &Path, size: (usize, usize), camera: &PinholeCamera) -> Result<(), Error> {
    let is_aside = (camera.cx_px / size.0 as f64 - 0.5).abs() > OFF_CENTRE;
    if is_aside || !(0.0..size.1 as f64).contains(&camera.cy_px) {
        let principal_point_px = (camera.cx_px, camera.cy_px);
        return Err(Error::OffCentre { path: path.into(), found: size, principal_point_px });
    }
    Ok(())
}

/// Checks that an image has the size of the others.
///
/// # Errors
/// [`Error::ImageSize`] where it has another.
pub fn check_size(path: &Path, found: (usize, usize), expected: (usize, usize)) -> Result<(), Error> {
    if found == expected { Ok(()) } else { Err(Error::ImageSize { path: path.into(), found, expected }) }
}

/// How every JPEG begins, whatever its file is called.
const JPEG: [u8; 3] = [0xff, 0xd8, 0xff];

/// Columns and rows of a PNG or JPEG, from its head.
///
/// # Errors
/// As [`read_image`].
pub fn image_size(path: &Path) -> Result<(usize, usize), Error> {
    let mut file = open(path)?;
    if is_jpeg(&mut file, path)? {
        let mut decoder = jpeg(read_all(file, path)?);
        decoder.decode_headers().map_err(|source| undecoded(path, source))?;
        return decoder.dimensions().ok_or_else(|| undecoded(path, NO_SIZE));
    }
    let read = png::Decoder::new(file).read_info();
    let (width, height) = read.map_err(|source| undecoded(path, source))?.info().size();
    Ok((width as usize, height as usize))
}

/// Reads a colour or grey image as 8-bit RGB: a PNG of any depth, of which transparency is
/// dropped, or a JPEG, told by how the file begins.
///
/// # Errors
/// [`common::Error::Io`] where it cannot be opened, [`Error::Decode`] where
/// it is no intact PNG or JPEG.
pub fn read_image(path: impl AsRef<Path>) -> Result<RgbImage, Error> {
    let path = path.as_ref();
    let mut file = open(path)?;
    if is_jpeg(&mut file, path)? {
        return read_jpeg(file, path);
    }
    let (width, colour, data) = decode(file).map_err(|source| undecoded(path, source))?;
    let samples = colour.samples();
    let data = match colour {
        png::ColorType::Rgb => data,
        png::ColorType::Rgba => data.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect(),
        _ => data.chunks_exact(samples).flat_map(|p| [p[0]; 3]).collect(),
    };
    RgbImage::new(width, data).ok_or_else(|| pixel_kind(path, colour, "8-bit RGB"))
}

fn read_jpeg(file: BufReader<File>, path: &Path) -> Result<RgbImage, Error> {
    let mut decoder = jpeg(read_all(file, path)?);
    let data = decoder.decode().map_err(|source| undecoded(path, source))?;
    let image = decoder.dimensions().and_then(|(width, _)| RgbImage::new(width, data));
    image.ok_or_else(|| undecoded(path, NO_SIZE))
}

const NO_SIZE: &str = "it has no pixels";

/// A decoder of RGB that takes nothing for granted: of an image that is cut off it gives an
/// error, and no grey rows.
fn jpeg(bytes: Vec<u8>) -> JpegDecoder<ZCursor<Vec<u8>>> {
    let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB).set_strict_mode(true);
    JpegDecoder::new_with_options(ZCursor::new(bytes), options)
}

fn open(path: &Path) -> Result<BufReader<File>, Error> {
    Ok(BufReader::new(File::open(path).map_err(common::Error::io(path))?))
}

/// Whether a file that was just opened is a JPEG; nothing of it is taken.
fn is_jpeg(file: &mut BufReader<File>, path: &Path) -> Result<bool, Error> {
    Ok(file.fill_buf().map_err(common::Error::io(path))?.starts_with(&JPEG))
}

fn read_all(mut file: BufReader<File>, path: &Path) -> Result<Vec<u8>, Error> {
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(common::Error::io(path))?;
    Ok(bytes)
}

fn undecoded(path: &Path, source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Error {
    Error::Decode { path: path.into(), source: source.into(), expected: "PNG or JPEG" }
}

/// The same of an image that must have lost nothing.
fn undecoded_png(path: &Path, source: png::DecodingError) -> Error {
    Error::Decode { path: path.into(), source: source.into(), expected: "PNG" }
}

/// Writes an 8-bit RGB PNG, whole or not at all.
///
/// # Errors
/// [`common::Error::Io`] or [`Error::Encode`] where it cannot be written.
pub fn write_png(path: impl AsRef<Path>, image: &RgbImage) -> Result<(), Error> {
    encode(path.as_ref(), (image.width(), image.height()), png::ColorType::Rgb, image.data())
}

/// Reads an 8-bit grey PNG.
///
/// # Errors
/// As [`read_image`], and [`Error::PixelKind`] where it is no 8-bit grey image:
/// a colour picture of probabilities has no agreed meaning.
pub fn read_grey_png(path: impl AsRef<Path>) -> Result<Plane, Error> {
    let path = path.as_ref();
    let (width, colour, data) = decode(open(path)?).map_err(|source| undecoded_png(path, source))?;
    let refused = || pixel_kind(path, colour, "8-bit grey");
    if colour != png::ColorType::Grayscale {
        return Err(refused());
    }
    Plane::new(width, data).ok_or_else(refused)
}

/// Writes an 8-bit grey PNG, whole or not at all.
///
/// # Errors
/// As [`write_png`].
pub fn write_grey_png(path: impl AsRef<Path>, plane: &Plane) -> Result<(), Error> {
    encode(path.as_ref(), (plane.width(), plane.height()), png::ColorType::Grayscale, plane.data())
}

fn pixel_kind(path: &Path, colour: png::ColorType, expected: &'static str) -> Error {
    Error::PixelKind { path: path.into(), found: format!("{colour:?}"), expected }
}

fn decode(file: BufReader<File>) -> Result<(usize, png::ColorType, Vec<u8>), png::DecodingError> {
    let mut decoder = png::Decoder::new(file);
    // To 8 bits per channel, palettes resolved.
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info()?;
    let bytes = reader.output_buffer_size().ok_or(png::DecodingError::LimitsExceeded)?;
    let mut data = vec![0; bytes];
    let frame = reader.next_frame(&mut data)?;
    data.truncate(frame.buffer_size());
    Ok((frame.width as usize, frame.color_type, data))
}

fn encode(path: &Path, size: (usize, usize), colour: png::ColorType, data: &[u8]) -> Result<(), Error> {
    let failed = |source| Error::Encode { path: path.into(), source };
    // PNG knows no larger images; the encoder refuses the wrong length.
    let (width, height) = (u32::try_from(size.0).unwrap_or(0), u32::try_from(size.1).unwrap_or(0));
    common::atomic_file::write_with(path, |out| {
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(colour);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(failed)?;
        writer.write_image_data(data).map_err(failed)?;
        writer.finish().map_err(failed)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn images_and_planes_survive_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let image = RgbImage::new(2, (0..18).collect()).unwrap();
        write_png(&path, &image).unwrap();
        assert_eq!(read_image(&path).unwrap(), image);
        let refused = read_grey_png(&path).unwrap_err().to_string();
        assert!(refused.contains("a.png") && refused.contains("8-bit grey"), "{refused}");
        let plane = Plane::new(3, (0..12).collect()).unwrap();
        write_grey_png(&path, &plane).unwrap();
        assert_eq!(read_grey_png(&path).unwrap(), plane);
        assert_eq!(read_image(&path).unwrap().row(1), &[3, 3, 3, 4, 4, 4, 5, 5, 5]);
    }

    #[test]
    fn what_an_image_shows_stays_where_it_is_at_another_size() {
        let value = |x: usize, y: usize| (4 * x + 2 * y) as u8;
        let grey = Plane::new(40, (0..20 * 40).map(|i| value(i % 40, i / 40)).collect()).unwrap();
        let rgb = RgbImage::new(40, grey.data().iter().flat_map(|&v| [v, v, v]).collect()).unwrap();
        let (small, of_colour) = (grey.clone().resized((20, 10)), rgb.resized((20, 10)).grey());
        for (x, y) in [(3, 2), (10, 5), (16, 8)] {
            // Four pixels about a corner between them.
            let mean = 0.5 * (f64::from(value(2 * x, 2 * y)) + f64::from(value(2 * x + 1, 2 * y + 1)));
            for image in [&small, &of_colour] {
                assert!((f64::from(image.row(y)[x]) - mean).abs() <= 1.0, "{x}, {y}: {} {mean}", image.row(y)[x]);
            }
        }
        assert_eq!(grey.clone().resized((40, 20)), grey);
    }

    #[test]
    fn a_broken_png_is_an_error_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.png");
        let image = RgbImage::new(40, vec![7; 3600]).unwrap();
        write_png(&path, &image).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in [0, 20, bytes.len() / 2] {
            std::fs::write(&path, &bytes[..length]).unwrap();
            assert!(read_image(&path).unwrap_err().to_string().contains("broken.png"));
        }
        assert!(read_image(folder.path().join("absent.png")).unwrap_err().to_string().contains("absent.png"));
    }

    #[test]
    fn a_jpeg_is_read_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let whole = std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/assets/street.jpg")).unwrap();
        // Cameras call theirs as they like.
        let path = folder.path().join("000000.png");
        std::fs::write(&path, &whole).unwrap();
        let image = read_image(&path).unwrap();
        assert_eq!(image_size(&path).unwrap(), (image.width(), image.height()));
        // Sky above a road: bright, and bluer than what is below.
        let mean = |y: usize, channel: usize| {
            let values = image.row(y).iter().skip(channel).step_by(3);
            values.map(|v| f64::from(*v)).sum::<f64>() / image.width() as f64
        };
        let (top, bottom) = (image.height() / 20, image.height() - image.height() / 20);
        assert!(mean(top, 2) > mean(bottom, 2) + 20.0, "{} {}", mean(top, 2), mean(bottom, 2));
        assert!(mean(top, 2) - mean(top, 0) > mean(bottom, 2) - mean(bottom, 0));
        for length in [3, 100, 1000, whole.len() / 2, whole.len() - 1000] {
            std::fs::write(&path, &whole[..length]).unwrap();
            let error = read_image(&path).unwrap_err().to_string();
            assert!(error.contains("000000.png") && error.contains("intact PNG or JPEG"), "{error}");
        }
        // Probabilities lose nothing on the way.
        std::fs::write(&path, &whole).unwrap();
        let error = read_grey_png(&path).unwrap_err().to_string();
        assert!(error.contains("000000.png") && error.contains("give an intact PNG image"), "{error}");
        let error = image_size(folder.path().join("absent.jpg").as_path()).unwrap_err().to_string();
        assert!(error.contains("absent.jpg"), "{error}");
    }

    #[test]
    fn a_scaled_image_does_not_fit_the_calibration() {
        let camera = PinholeCamera {
            fx_px: 718.856,
            fy_px: 718.856,
            cx_px: 607.19,
            cy_px: 185.22,
            from_reference_m: Vector3::zeros(),
        };
        let path = Path::new("000000.png");
        assert!(check_calibration(path, (1226, 370), &camera).is_ok());
        // Without the sky, or the bonnet.
        assert!([200, 270].into_iter().all(|rows| check_calibration(path, (1226, rows), &camera).is_ok()));
        for (width, height) in [(613, 185), (2452, 740), (1226, 150)] {
            let error = check_calibration(path, (width, height), &camera).unwrap_err().to_string();
            assert!(error.contains(&format!("000000.png has {width}x{height} px")), "{error}");
        }
        let error = check_size(path, (1241, 376), (1226, 370)).unwrap_err().to_string();
        assert!(error.contains("1241x376") && error.contains("1226x370"), "{error}");
    }
}
