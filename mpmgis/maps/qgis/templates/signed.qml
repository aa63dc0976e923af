<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<qgis version="3.22.0" styleCategories="AllStyleCategories">
 <pipe>
  <rasterrenderer type="singlebandpseudocolor" band="$band" opacity="$opacity" alphaBand="-1" nodataColor="" classificationMin="$lowest" classificationMax="$highest">
   <minMaxOrigin><limits>None</limits><extent>WholeRaster</extent><statAccuracy>Exact</statAccuracy></minMaxOrigin>
   <rastershader>
    <colorrampshader colorRampType="INTERPOLATED" classificationMode="1" clip="0" minimumValue="$lowest" maximumValue="$highest" labelPrecision="2">
     <colorramp name="[source]" type="gradient">
      <Option type="Map">
       <Option type="QString" name="color1" value="$first"/>
       <Option type="QString" name="color2" value="$last"/>
       <Option type="QString" name="discrete" value="0"/>
       <Option type="QString" name="rampType" value="gradient"/>
       <Option type="QString" name="stops" value="$stops"/>
      </Option>
      <prop k="color1" v="$first"/>
      <prop k="color2" v="$last"/>
      <prop k="discrete" v="0"/>
      <prop k="rampType" v="gradient"/>
      <prop k="stops" v="$stops"/>
     </colorramp>
     $items
     <rampLegendSettings useContinuousLegend="1" orientation="2" direction="0" minimumLabel="" maximumLabel="" prefix="" suffix=" $unit"/>
    </colorrampshader>
   </rastershader>
  </rasterrenderer>
 </pipe>
 <blendMode>0</blendMode>
</qgis>
