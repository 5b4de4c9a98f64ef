//! How QGIS draws the layers when they are opened: one default style a layer in the table `layer_styles`.
//!
//! The table is QGIS's own convention, not part of the GeoPackage standard; others ignore it. Colours: trees brown,
//! drawn larger with their diameter and labelled with it in centimetres; drops red, walls grey, rocks slate, brush green.

use super::layers::Layer;
use geopackage::core::types::ColumnType;
use geopackage::{ColumnSpec, GeoPackage, TableSchemaBuilder};

/// Fill and outline, red, green, blue, opacity.
type Colors = (&'static str, &'static str);

/// Writes a style for each layer.
pub fn write(gpkg: &GeoPackage, layers: impl Iterator<Item = &'static Layer>) -> geopackage::Result<()> {
    let text = |name| ColumnSpec::new(name, ColumnType::Text(None));
    let table = TableSchemaBuilder::new("layer_styles")
        .primary_key("id")
        .column(text("f_table_catalog"))
        .column(text("f_table_schema"))
        .column(text("f_table_name"))
        .column(text("f_geometry_column"))
        .column(text("styleName"))
        .column(text("styleQML"))
        .column(text("styleSLD"))
        .column(ColumnSpec::new("useAsDefault", ColumnType::Boolean))
        .column(text("description"))
        .column(text("owner"))
        .column(text("ui"))
        .column(
            ColumnSpec::new("update_time", ColumnType::DateTime)
                .default_value("(strftime('%Y-%m-%dT%H:%M:%fZ','now'))"),
        );
    gpkg.create_attributes_table(&table)?;
    let sql = "INSERT INTO layer_styles (f_table_catalog, f_table_schema, f_table_name, f_geometry_column, styleName, \
               styleQML, styleSLD, useAsDefault, description, owner, update_time) \
               VALUES ('', '', ?1, 'geom', ?1, ?2, '', 1, ?3, '', '1970-01-01T00:00:00.000Z')";
    let mut insert = gpkg.connection().prepare(sql)?;
    for layer in layers {
        insert.execute([layer.name, &style_of(layer.name), layer.description])?;
    }
    Ok(())
}

fn style_of(layer: &str) -> String {
    match layer {
        "trees" => trees(),
        "rejected" => points(("190,190,190,160", "110,110,110,255"), "cross", "1.6", ""),
        "drops" => polygons(("214,64,51,110", "166,30,20,255"), "depth_max_m"),
        "walls" => polygons(("90,90,96,190", "40,40,44,255"), "height_max_m"),
        "rocks" => polygons(("122,136,152,170", "70,82,96,255"), "height_max_m"),
        _ => polygons(("104,159,56,90", "74,120,36,160"), ""),
    }
}

/// Circles that grow with the diameter, each with it as a label where one is near enough.
fn trees() -> String {
    let size = "<data_defined_properties><Option type=\"Map\"><Option name=\"name\" type=\"QString\" value=\"\"/>\
        <Option name=\"properties\" type=\"Map\"><Option name=\"size\" type=\"Map\">\
        <Option name=\"active\" type=\"bool\" value=\"true\"/>\
        <Option name=\"expression\" type=\"QString\" value=\"scale_linear(coalesce(&quot;dbh_m&quot;, 0.2), 0.05, 0.8, 1.8, 7)\"/>\
        <Option name=\"type\" type=\"int\" value=\"3\"/></Option></Option>\
        <Option name=\"type\" type=\"QString\" value=\"collection\"/></Option></data_defined_properties>";
    let symbol = points(("139,94,60,230", "60,36,20,255"), "circle", "3", size);
    let label = labeling("to_string(round(&quot;dbh_m&quot; * 100)) || ' cm'", 600);
    symbol.replace("</qgis>", &format!("{label}</qgis>"))
}

fn labeling(expression: &str, scale: u32) -> String {
    format!(
        "<labeling type=\"simple\"><settings calloutType=\"simple\"><text-style isExpression=\"1\" \
         fieldName=\"{expression}\" fontSize=\"8\" textColor=\"60,36,20,255\"><text-buffer bufferDraw=\"1\" \
         bufferSize=\"0.8\" bufferColor=\"255,255,255,255\"/></text-style><placement placement=\"6\" dist=\"0.6\"/>\
         <rendering scaleVisibility=\"1\" scaleMin=\"1\" scaleMax=\"{scale}\" drawLabels=\"1\"/></settings></labeling>"
    )
}

fn option(name: &str, value: &str) -> String {
    format!("<Option name=\"{name}\" type=\"QString\" value=\"{value}\"/>")
}

fn qml(symbol: &str, geometry: u8, labels: bool) -> String {
    format!(
        "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n\
         <qgis version=\"3.22\" styleCategories=\"Symbology|Labeling\" labelsEnabled=\"{}\">\
         <renderer-v2 type=\"singleSymbol\" symbollevels=\"0\" enableorderby=\"0\" forceraster=\"0\">\
         <symbols>{symbol}</symbols></renderer-v2><layerGeometryType>{geometry}</layerGeometryType></qgis>",
        u8::from(labels)
    )
}

fn points((fill, line): Colors, shape: &str, size_mm: &str, defined: &str) -> String {
    let options =
        [option("name", shape), option("color", fill), option("outline_color", line), option("size", size_mm)];
    let symbol = format!(
        "<symbol name=\"0\" type=\"marker\" alpha=\"1\" clip_to_extent=\"1\" force_rhr=\"0\">\
         <layer class=\"SimpleMarker\" enabled=\"1\" locked=\"0\" pass=\"0\"><Option type=\"Map\">{}{}{}</Option>{defined}</layer></symbol>",
        options.concat(),
        option("outline_width", "0.3"),
        option("size_unit", "MM"),
    );
    qml(&symbol, 0, !defined.is_empty())
}

fn polygons((fill, line): Colors, label: &str) -> String {
    let options = [
        option("color", fill),
        option("outline_color", line),
        option("outline_width", "0.3"),
        option("style", "solid"),
    ];
    let symbol = format!(
        "<symbol name=\"0\" type=\"fill\" alpha=\"1\" clip_to_extent=\"1\" force_rhr=\"0\">\
         <layer class=\"SimpleFill\" enabled=\"1\" locked=\"0\" pass=\"0\"><Option type=\"Map\">{}</Option></layer></symbol>",
        options.concat()
    );
    let style = qml(&symbol, 2, !label.is_empty());
    if label.is_empty() {
        return style;
    }
    let label = labeling(&format!("to_string(round(&quot;{label}&quot;, 1)) || ' m'"), 300);
    style.replace("</qgis>", &format!("{label}</qgis>"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every element that opens closes again, in its order.
    fn is_well_formed(xml: &str) -> bool {
        let mut open = Vec::new();
        for tag in xml.split('<').skip(1).filter(|tag| !tag.starts_with('!')) {
            let (tag, _) = tag.split_once('>').unwrap();
            let name = tag.split([' ', '/']).find(|word| !word.is_empty()).unwrap();
            match (tag.starts_with('/'), tag.ends_with('/')) {
                (true, _) if open.pop() != Some(name) => return false,
                (false, false) => open.push(name),
                _ => {}
            }
        }
        open.is_empty()
    }

    #[test]
    fn styles_are_well_formed() {
        for layer in ["trees", "rejected", "drops", "walls", "rocks", "brush"] {
            let style = style_of(layer);
            assert!(is_well_formed(&style), "{layer}: {style}");
        }
        assert!(!is_well_formed("<a><b></a></b>"));
    }
}
