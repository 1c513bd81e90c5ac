use super::*;

#[test]
fn lines_say_what_they_say_and_paths_keep_their_blanks() {
    let config = GpsConfig::default();
    let said = |text| said(text, &config, None);
    let image = |time_s, frame, path: Option<&'static str>| Said::Image { time_s, frame, path: path.map(Path::new) };
    assert_eq!(said("image 1.5 7"), Some(image(1.5, 7, None)));
    assert_eq!(said("image 1.5 7 a b, c.png"), Some(image(1.5, 7, Some("a b, c.png"))));
    assert_eq!(said("image,1.5,\t7,x.png"), Some(image(1.5, 7, Some("x.png"))));
    let wheels = Said::Odometry { time_s: 1.0, speed_m_s: -2.0, yaw_rate_rad_s: 0.03 };
    assert_eq!(said("odometry 1 -2 3e-2"), Some(wheels));
    let Some(Said::Gps { time_s, fix }) = said("gps 1 2 3 4 0 0.7071068 0 0.7071068") else { unreachable!() };
    assert!((time_s - 1.0).abs() < 1e-12 && fix.is_course && (fix.position_map.z - 4.0).abs() < 1e-12);
    for bad in [
        "",
        "imag 1 2",
        "image",
        "image 1",
        "image x 1",
        "image nan 1",
        "image 1 -1",
        "image 1 1.5",
        "odometry 1 2",
        "odometry 1 2 3 4",
        "odometry 1 2 inf",
        "gps 1 2 3",
        "gps 1 2 3 4 5",
        "gps 1 2 3 nan",
    ] {
        assert_eq!(said(bad), None, "{bad}");
    }
}

#[test]
fn a_receiver_s_degrees_are_a_place_in_a_map_that_is_on_the_earth() {
    let on_earth = OnEarth::new("49,8,100,90".parse().unwrap(), common::earth::Projection::Topocentric);
    let config = GpsConfig::default();
    let said = |text| said(text, &config, Some(&on_earth));
    let Some(Said::Gps { fix, .. }) = said("gps 1.5 49.0 8.001 100 90") else { unreachable!() };
    // Meridians converge by a hundred-thousandth over these 73 m.
    assert!((fix.position_map.z - 73.2).abs() < 0.2 && fix.heading.unwrap().0.abs() < 1e-4, "{fix:?}");
    assert_eq!((said("gps 1.5 8 49 100"), said("gps 1 2 3 4 0 0.7071068 0 0.7071068")), (None, None));
}

#[test]
fn a_line_without_end_is_refused_before_it_fills_the_memory() {
    let mut input = std::io::Cursor::new([b"image 1 2\n".to_vec(), vec![b'x'; 1 << 20]].concat());
    assert_eq!(next_line(&mut input, 1).unwrap().unwrap(), "image 1 2\n");
    let said = next_line(&mut input, 2).unwrap_err().to_string();
    assert!(said.contains("line 2 of the standard input") && said.contains("16384"), "{said}");
    assert!(next_line(&mut std::io::Cursor::new(b""), 1).unwrap().is_none());
    assert_eq!(next_line(&mut std::io::Cursor::new(b"# no end"), 1).unwrap().unwrap(), "# no end");
}
